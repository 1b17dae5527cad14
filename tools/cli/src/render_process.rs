//! The renderer of `esaac demo`: this program once more, as `esaac render`.

use crate::arguments::CommonArguments;
use crate::demo::{DemoArguments, RATE_HZ};
use crate::device_choice::uuid_text;
use crate::program;
use anyhow::{Context, Result, bail};
use esaac_engine::Device;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

/// A running renderer; it ends with this value.
pub struct RenderProcess {
    child: Child,
}

impl RenderProcess {
    /// Starts it on the same device.
    pub fn start(
        socket: &Path,
        arguments: &DemoArguments,
        device: &Device,
        common: &CommonArguments,
    ) -> Result<Self> {
        let (program, first_arguments) = program::again().context("this program's own path")?;
        let mut command = Command::new(program);
        command
            .args(first_arguments)
            .args(["render", "--scene", arguments.scene.name()])
            .args(["--frames", &arguments.frames.to_string(), "--rate", &RATE_HZ.to_string()])
            .args(["--device", &uuid_text(&device.info().uuid)])
            // The first tick may build kernels for minutes; an engine that is gone is seen at once.
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

    /// Fails if it has ended by fault.
    pub fn check_alive(&mut self, notices: &[String]) -> Result<()> {
        match self.child.try_wait().context("`esaac render`")? {
            Some(status) if !status.success() => Err(self.fault(status)),
            _ if notices.is_empty() => Ok(()),
            _ => bail!("the renderer is lost: {}", notices.join("; ")),
        }
    }

    /// Waits for its end.
    pub fn finish(mut self) -> Result<()> {
        let status = self.child.wait().context("`esaac render`")?;
        if status.success() { Ok(()) } else { Err(self.fault(status)) }
    }

    fn fault(&mut self, status: ExitStatus) -> anyhow::Error {
        let mut words = String::new();
        if let Some(error) = &mut self.child.stderr {
            // What it could say before it ended is all there is.
            let _ = error.read_to_string(&mut words);
        }
        anyhow::anyhow!("`esaac render` has ended ({status}): {}", words.trim())
    }
}

impl Drop for RenderProcess {
    fn drop(&mut self) {
        // An ended process cannot be killed, which is as well.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
