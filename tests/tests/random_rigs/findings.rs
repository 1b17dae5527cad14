//! What a case shows that should not be.

/// Texts of all that is wrong with a case.
#[derive(Default)]
pub struct Findings(Vec<String>);

/// More would tell nothing new.
const MOST: usize = 12;

impl Findings {
    /// Notes what is wrong unless it holds.
    pub fn check(&mut self, holds: bool, what: impl FnOnce() -> String) {
        if !holds {
            self.0.push(what());
        }
    }

    /// The first of them, one a line; `None` if all is well.
    pub fn text(&self) -> Option<String> {
        let more = self.0.len().saturating_sub(MOST);
        let mut text = self.0[..self.0.len() - more].join("\n");
        if more > 0 {
            text += &format!("\nand {more} more");
        }
        (!self.0.is_empty()).then_some(text)
    }
}
