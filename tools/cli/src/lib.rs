//! The command `esaac` as a library: one module per subcommand, and the parts that they share.
//!
//! [`program::run`] parses [`command_line::Arguments`], runs one command and turns its [`outcome::Outcome`]
//! into text on standard output and an exit code. Progress, warnings and errors go to standard error.
//! Standard output holds the report alone, so that another program can read it with `--json`.

// `eprintln` panics where standard error cannot be written; `stderr::line` does not.
#![warn(clippy::print_stderr)]

pub mod accuracy;
pub mod arguments;
pub mod bench;
pub mod calibrate;
pub mod canvas;
pub mod characterise;
pub mod colour;
pub mod command_line;
#[cfg(test)]
mod commit;
pub mod compare;
pub mod counted;
pub mod demo;
pub mod device_choice;
pub mod devices;
pub mod doctor;
mod event_output;
pub mod frame_channels;
pub mod frame_folder;
pub mod frame_numbers;
pub mod frame_series;
mod gathered;
pub mod interrupt;
pub mod kernel_source;
pub mod link_report;
pub mod motion_convention;
pub mod outcome;
pub mod output_file;
pub mod overview;
pub mod own_program;
pub mod pace;
pub mod pixel_notes;
pub mod pose_report;
pub mod program;
pub mod progress;
pub mod rate_argument;
pub mod render;
pub mod render_process;
pub mod replay;
pub mod report;
pub mod rig_file;
pub mod ros;
pub mod run_record;
pub mod scene_argument;
pub mod scene_check;
pub mod scene_light;
pub mod sensor_base;
pub mod sensor_flags;
pub mod sensors;
pub mod serve;
pub mod simulate;
pub mod stderr;
pub mod synthesis_choice;
pub mod table;
pub mod unread_flags;
pub mod version;
mod warnings;
pub mod whole_argument;
