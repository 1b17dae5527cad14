//! Who feeds which camera. A camera has one producer at most, from the HELLO that the engine accepts until
//! that connection ends. This is the only place that decides it.

use crate::error::InteropError;
use crate::socket::Credentials;
use crate::wire::ErrorCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The connection that holds a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Holder {
    connection: u64,
    process: i32,
}

/// Holders of all cameras of a rig.
pub(super) struct Claims {
    holders: Mutex<Vec<Option<Holder>>>,
}

/// The right to feed one camera. Dropping it frees the camera.
pub(super) struct Claim {
    claims: Arc<Claims>,
    camera: usize,
}

impl Claims {
    pub(super) fn new(cameras: usize) -> Arc<Self> {
        Arc::new(Claims { holders: Mutex::new(vec![None; cameras]) })
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Option<Holder>>> {
        self.holders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives the camera to a connection, or says who holds it.
    pub(super) fn take(
        self: &Arc<Self>,
        camera: usize,
        connection: u64,
        peer: Credentials,
    ) -> Result<Claim, InteropError> {
        let mut holders = self.lock();
        let cameras = holders.len();
        let refused = |code, text| Err(InteropError::Refused { code, text });
        let Some(holder) = holders.get_mut(camera) else {
            return refused(ErrorCode::Camera, format!("camera {camera}, the rig has {cameras}"));
        };
        if let Some(Holder { connection, process }) = *holder {
            let process = match process {
                0 => "a process of another container".to_owned(),
                process => format!("process {process}"),
            };
            let text =
                format!("camera {camera} has a producer already: {process} by connection {connection}");
            return refused(ErrorCode::Taken, text);
        }
        *holder = Some(Holder { connection, process: peer.process });
        drop(holders);
        Ok(Claim { claims: Arc::clone(self), camera })
    }
}

impl Claim {
    /// Which camera.
    pub(super) fn camera(&self) -> usize {
        self.camera
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        self.claims.lock()[self.camera] = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn peer(process: i32) -> Credentials {
        Credentials { user: 0, process }
    }

    #[test]
    fn the_second_producer_is_told_the_camera_and_its_holder() {
        let claims = Claims::new(2);
        let first = claims.take(1, 7, peer(4242)).unwrap();
        let Err(error) = claims.take(1, 8, peer(99)) else { panic!("camera 1 was given twice") };
        assert_eq!(error.code(), ErrorCode::Taken);
        let text = error.to_string();
        assert!(text.contains("camera 1 has a producer already: process 4242 by connection 7"), "{text}");
        let _outside = claims.take(0, 9, peer(0)).unwrap();
        let text = claims.take(0, 10, peer(99)).err().expect("taken").to_string();
        assert!(text.contains("a process of another container by connection 9"), "{text}");
        drop(first);
        assert_eq!(claims.take(1, 8, peer(99)).unwrap().camera(), 1);
        let Err(error) = claims.take(2, 9, peer(1)) else { panic!("there is no camera 2") };
        assert_eq!(error.code(), ErrorCode::Camera);
    }

    proptest! {
        /// Whatever connections come and go, each camera has the holder that a plain table says.
        #[test]
        fn a_camera_never_has_two_holders(steps in proptest::collection::vec((0_usize..3, any::<bool>()), 0..80)) {
            let claims = Claims::new(3);
            let mut held: [Option<Claim>; 3] = [const { None }; 3];
            for (connection, (camera, comes)) in (0..).zip(steps) {
                if !comes {
                    held[camera] = None;
                    continue;
                }
                match claims.take(camera, connection, peer(1)) {
                    Ok(claim) => {
                        prop_assert!(held[camera].is_none(), "camera {} was given twice", camera);
                        held[camera] = Some(claim);
                    }
                    Err(_) => prop_assert!(held[camera].is_some(), "camera {} is free", camera),
                }
            }
        }
    }
}
