//! Finds out whether CUDA supports the device under test.

use esaac_interop::cuda::{CudaDevice, CudaOptions, CudaProducer, cuda_devices};
use esaac_interop::wire::ErrorCode;
use esaac_interop::{InteropError, ServerOptions};
use esaac_model::{SensorModel, Synthesis};
use esaac_tests::device::DEVICE;
use esaac_tests::interop::{Place, flight, service};

/// Number of frames of a run.
pub fn frames() -> usize {
    std::env::var("ESAAC_CUDA_FRAMES").map_or(2000, |n| n.parse().expect("ESAAC_CUDA_FRAMES is a number"))
}

/// The CUDA device that is the device under test. If there is none, asserts that the producer's error says why, and
/// returns `None`.
pub fn cuda_or_a_clear_error() -> Option<CudaDevice> {
    let place = Place::default();
    let sensor = SensorModel { width: 9, height: 9, synthesis: Synthesis::None, ..SensorModel::default() };
    let sequence = flight(&sensor).first(1);
    let _service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let devices = match cuda_devices() {
        Ok(devices) => devices,
        Err(error) => {
            let text = error.to_string();
            match error {
                InteropError::NoCuda => assert!(text.contains("libcuda.so.1") && text.contains("install")),
                InteropError::NoCudaDevice { .. } => assert!(text.contains("no CUDA device"), "{text}"),
                _ => panic!("CUDA is there and broken: {text}"),
            }
            let Err(error) = CudaProducer::connect(&place.path(), &CudaOptions::default()) else {
                panic!("a CUDA producer without CUDA");
            };
            assert_eq!(error.to_string(), text);
            println!("no CUDA here: {text}");
            return None;
        }
    };
    let own = devices.iter().find(|device| device.uuid == DEVICE.info().uuid).copied();
    if own.is_none() {
        match CudaProducer::connect(&place.path(), &CudaOptions::default()) {
            Err(InteropError::Refused { code: ErrorCode::Device, text }) => {
                assert!(text.contains("start both on one device"), "{text}");
            }
            Err(error) => panic!("{error}"),
            Ok(_) => panic!("a CUDA producer on another device"),
        }
    }
    own
}
