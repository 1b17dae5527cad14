//! Values that belong to one process. A child of fork() has copies of the handles, but not of the GPU's objects.

use crate::error::Fault;
use std::mem::ManuallyDrop;

/// A value that is used and dropped only in the process that made it.
pub struct OwnProcess<T> {
    value: ManuallyDrop<T>,
    owner: u32,
}

impl<T> OwnProcess<T> {
    /// A value of this process.
    pub fn new(value: T) -> Self {
        OwnProcess { value: ManuallyDrop::new(value), owner: std::process::id() }
    }

    /// The value; an error in another process.
    pub fn get(&self) -> Result<&T, Fault> {
        let here = std::process::id();
        if here == self.owner { Ok(&self.value) } else { Err(Fault::Forked { owner: self.owner, here }) }
    }

    /// As [`OwnProcess::get`], to change it.
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
