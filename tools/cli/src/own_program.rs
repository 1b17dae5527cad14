//! How to start this program a second time.

use std::ffi::OsString;
use std::sync::OnceLock;

/// The words that start it; unset if its own file does.
static WORDS: OnceLock<Vec<String>> = OnceLock::new();

/// Sets the words that start the program, if the file of this process is another program's.
pub fn set_start(words: &[String]) {
    if !words.is_empty() {
        // A later call cannot change how the process was started.
        let _ = WORDS.set(words.to_vec());
    }
}

/// The file that starts the program, and its first arguments.
pub fn start() -> std::io::Result<(OsString, Vec<String>)> {
    match WORDS.get().and_then(|words| words.split_first()) {
        Some((program, arguments)) => Ok((program.into(), arguments.to_vec())),
        None => Ok((std::env::current_exe()?.into_os_string(), Vec::new())),
    }
}
