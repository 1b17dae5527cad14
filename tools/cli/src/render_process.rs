//! Starts this program a second time, as `esaac render`.

use crate::arguments::CommonArguments;
use crate::device_choice::uuid_text;
use crate::own_program;
use anyhow::{Context, Result, bail};
use esaac_engine::Device;
use esaac_scene::SceneKind;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;

/// What it renders.
#[derive(Clone, Copy, Debug)]
pub struct RenderJob {
    /// Scene.
    pub scene: SceneKind,
    /// Number of frames.
    pub frames: u32,
    /// Frames per second of simulated time.
    pub rate_hz: f64,
}

/// A running renderer. Dropping this value ends it.
pub struct RenderProcess {
    child: Child,
    /// Reads its standard error to the end, so that the pipe never fills up.
    words: Option<JoinHandle<String>>,
}

impl RenderProcess {
    /// Starts a renderer for the service at `socket`, on the same device.
    pub fn start(socket: &Path, job: RenderJob, device: &Device, common: &CommonArguments) -> Result<Self> {
        let (program, first_arguments) = own_program::start().context("this program's own path")?;
        let mut command = Command::new(program);
        command
            .args(first_arguments)
            .args(["render", "--scene", job.scene.name()])
            .args(["--frames", &job.frames.to_string(), "--rate", &job.rate_hz.to_string()])
            .args(["--device", &uuid_text(&device.info().uuid)])
            // Kernels may compile for minutes before the first tick. If the engine ends, the renderer sees it
            // at once.
            .args(["--patience", "3600"])
            .arg("--socket")
            .arg(socket)
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        if common.validation {
            command.arg("--validation");
        }
        RenderProcess::of(&mut command)
    }

    fn of(command: &mut Command) -> Result<Self> {
        let mut child = command.stderr(Stdio::piped()).spawn().context("cannot start `esaac render`")?;
        let words = child.stderr.take().map(|mut stderr| {
            std::thread::spawn(move || {
                let mut words = Vec::new();
                // If this fails, the exit status and what was read are all that is known.
                let _ = stderr.read_to_end(&mut words);
                String::from_utf8_lossy(&words).into_owned()
            })
        });
        Ok(RenderProcess { child, words })
    }

    /// Fails if the renderer has failed, or if the service lost it, which `notices` say.
    pub fn check_alive(&mut self, notices: &[String]) -> Result<()> {
        match self.child.try_wait().context("`esaac render`")? {
            Some(status) if !status.success() => Err(self.fault(status)),
            _ if notices.is_empty() => Ok(()),
            _ => bail!("the renderer is lost: {}", notices.join("; ")),
        }
    }

    /// Waits until the renderer ends.
    pub fn finish(mut self) -> Result<()> {
        let status = self.child.wait().context("`esaac render`")?;
        if status.success() { Ok(()) } else { Err(self.fault(status)) }
    }

    fn fault(&mut self, status: ExitStatus) -> anyhow::Error {
        let words = self.words.take().and_then(|words| words.join().ok()).unwrap_or_default();
        anyhow::anyhow!("`esaac render` has ended ({status}): {}", words.trim())
    }
}

impl Drop for RenderProcess {
    fn drop(&mut self) {
        // An error means that the process has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_renderer_that_says_more_than_a_pipe_holds_ends_and_is_quoted() {
        let script = "head -c 300000 /dev/zero | tr '\\0' x >&2; echo the last word >&2; exit 3";
        let renderer = RenderProcess::of(Command::new("sh").args(["-c", script])).unwrap();
        let error = renderer.finish().unwrap_err().to_string();
        assert!(error.ends_with("xthe last word") && error.len() > 300_000, "{} bytes", error.len());
    }
}
