//! What a command warns of.

use crate::stderr;
use serde::Serialize;
use std::fmt::Display;

/// Warnings, told on standard error at once and kept for the report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Warnings(Vec<String>);

impl Warnings {
    /// Tells one.
    pub fn tell(&mut self, text: impl Display) {
        let text = text.to_string();
        stderr::line(format_args!("warning: {text}"));
        self.0.push(text);
    }

    /// Tells all of these.
    pub fn tell_all(&mut self, texts: impl IntoIterator<Item = impl Display>) {
        texts.into_iter().for_each(|text| self.tell(text));
    }

    /// Keeps these, which standard error has already.
    pub fn keep_all(&mut self, texts: impl IntoIterator<Item = String>) {
        self.0.extend(texts);
    }
}
