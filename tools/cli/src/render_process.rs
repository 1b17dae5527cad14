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
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        if common.validation {
            command.arg("--validation");
        }
        let child = command.spawn().context("cannot start `esaac render`")?;
        Ok(RenderProcess { child })
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
        let mut words = String::new();
        if let Some(error) = &mut self.child.stderr {
            // If this fails, the exit status is all that is known.
            let _ = error.read_to_string(&mut words);
        }
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
