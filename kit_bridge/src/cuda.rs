//! CUDA's side of the device: it copies frames in, and lends memory blocks to tensors.

use crate::error::Fault;
use crate::process::OwnProcess;
use esaac_engine::Device;
use esaac_interop::cuda::{CudaBuffer, CudaLink};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most blocks that are kept for reuse. Others are freed.
const SPARE_BLOCKS: usize = 8;

/// The engine's device as CUDA sees it.
pub struct CudaSide {
    /// Blocks that no tensor views any more. Pending work may still read them.
    spare: Mutex<VecDeque<CudaBuffer>>,
    link: Mutex<CudaLink>,
    /// CUDA's number of the device.
    pub ordinal: i32,
    /// Handle of the link's stream.
    pub stream: u64,
}

/// Memory that tensors view. It may be reused when the last of them is gone.
pub struct Block {
    memory: OwnProcess<(Option<CudaBuffer>, Arc<CudaSide>)>,
    pointer: u64,
}

impl CudaSide {
    /// Finds the engine's device among CUDA's.
    pub fn open(device: &Arc<Device>) -> Result<Arc<Self>, Fault> {
        let link = CudaLink::open(device)?;
        let (ordinal, stream) = (link.ordinal(), link.stream());
        Ok(Arc::new(CudaSide { spare: Mutex::default(), link: Mutex::new(link), ordinal, stream }))
    }

    /// The link, for one caller at a time.
    pub fn link(&self) -> MutexGuard<'_, CudaLink> {
        self.link.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A block of at least `bytes` that no pending work reads.
    pub fn block(self: &Arc<Self>, bytes: u64) -> Result<Block, Fault> {
        let used = {
            let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
            // The smallest that is large enough, unless it is many times too large.
            let fits = |buffer: &CudaBuffer| {
                (bytes..=bytes.saturating_mul(4).max(1 << 20)).contains(&buffer.buffer().bytes())
            };
            let best =
                (0..spare.len()).filter(|&i| fits(&spare[i])).min_by_key(|&i| spare[i].buffer().bytes());
            best.and_then(|index| spare.remove(index))
        };
        let buffer = match used {
            Some(buffer) => {
                // No tensor views it, but work that was enqueued before may still read it.
                self.link().settle()?;
                buffer
            }
            // A little more than needed, so that a somewhat longer packet fits too.
            None => self.link().buffer("tensors", bytes + bytes / 4)?,
        };
        Ok(Block { pointer: buffer.pointer(), memory: OwnProcess::new((Some(buffer), Arc::clone(self))) })
    }
}

impl Block {
    /// `CUdeviceptr` of its first byte.
    pub fn pointer(&self) -> u64 {
        self.pointer
    }

    /// The memory, and the device that it is on.
    pub fn memory(&self) -> Result<(&CudaBuffer, &Arc<CudaSide>), Fault> {
        let (buffer, side) = self.memory.get()?;
        Ok((buffer.as_ref().expect("there until it is dropped"), side))
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        // A forked process has neither the memory nor the device.
        if let Ok((memory, side)) = self.memory.get_mut()
            && let Some(buffer) = memory.take()
        {
            let mut spare = side.spare.lock().unwrap_or_else(PoisonError::into_inner);
            spare.push_back(buffer);
            // The oldest block has a size that is no longer asked for.
            let left_over = if spare.len() > SPARE_BLOCKS { spare.pop_front() } else { None };
            drop(spare);
            // Pending work may read it, so wait before it is freed.
            if left_over.is_some()
                && let Err(error) = side.link().settle()
            {
                eprintln!("esaac: {error}");
            }
        }
    }
}

impl Drop for CudaSide {
    fn drop(&mut self) {
        if let Err(error) = self.link().settle() {
            eprintln!("esaac: {error}");
        }
    }
}
