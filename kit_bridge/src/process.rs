//! What belongs to the process that made it: a child of fork() has copies of handles, not of what they name.

use crate::error::Fault;
use std::mem::ManuallyDrop;

/// A value that is used and dropped in its own process only.
pub struct OwnProcess<T> {
    value: ManuallyDrop<T>,
    owner: u32,
}

impl<T> OwnProcess<T> {
    /// This process's.
    pub fn new(value: T) -> Self {
        OwnProcess { value: ManuallyDrop::new(value), owner: std::process::id() }
    }

    /// The value, unless this is another process.
    pub fn get(&self) -> Result<&T, Fault> {
        let here = std::process::id();
        if here == self.owner { Ok(&self.value) } else { Err(Fault::Forked { owner: self.owner, here }) }
    }

    /// The same, to change it.
    pub fn get_mut(&mut self) -> Result<&mut T, Fault> {
        self.get()?;
        Ok(&mut self.value)
    }
}

impl<T> Drop for OwnProcess<T> {
    fn drop(&mut self) {
        if std::process::id() == self.owner {
            // SAFETY: dropped once, here, and not used again.
            #[expect(unsafe_code, reason = "a value that a child of fork() must not drop")]
            unsafe {
                ManuallyDrop::drop(&mut self.value);
            }
        }
    }
}
