//! A producer on another GPU than the engine's. On a machine with one GPU, a device that does not exist takes its
//! place.

use crate::present::cuda_or_a_clear_error;
use esaac_engine::DeviceChoice;
use esaac_interop::cuda::{CudaOptions, CudaProducer, cuda_devices};
use esaac_interop::wire::ErrorCode;
use esaac_interop::{InteropError, ServerOptions};
use esaac_model::{SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::interop::{Place, flight, service};

#[test]
fn it_is_refused_and_told_both_names() {
    let Some(own) = cuda_or_a_clear_error() else { return };
    let sensor = SensorModel { width: 9, height: 9, synthesis: Synthesis::None, ..SensorModel::default() };
    let sequence = flight(&sensor).first(1);
    let place = Place::default();
    let service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let connect = |device: Option<[u8; 16]>| {
        CudaProducer::connect(&place.path(), &CudaOptions { device, ..CudaOptions::default() })
    };
    let name = |uuid: [u8; 16]| DeviceChoice::Uuid(uuid).to_string();

    let Err(error) = connect(Some([0xee; 16])) else { panic!("a device that is not there") };
    assert!(matches!(error, InteropError::NoCudaDevice { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains(&name([0xee; 16])) && text.contains(&name(own.uuid)), "{text}");

    let others: Vec<_> = cuda_devices().unwrap().into_iter().filter(|d| d.uuid != own.uuid).collect();
    println!("the engine is on cuda:{}; {} other GPUs", own.ordinal, others.len());
    for other in others {
        let Err(error) = connect(Some(other.uuid)) else { panic!("memory of one GPU on another") };
        assert!(matches!(&error, InteropError::Refused { code: ErrorCode::Device, .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains(&name(other.uuid)) && text.contains(&name(DEVICE.info().uuid)), "{text}");
        println!("cuda:{}: {text}", other.ordinal);
    }
    // Without a choice of device, the producer finds the engine's.
    drop(connect(None).unwrap());
    drop(service);
    assert_silent();
}
