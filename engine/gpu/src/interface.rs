//! What holds kernels and Rust together: which kernels there are, and that what each says of itself is
//! what Rust uses. The build script checks those that it embeds, a kernel folder those that it compiles.

use esaac_kernels::Reflection;
use esaac_model::layout::{
    BINDINGS, CAMERAS, COUNTERS, CROSS_THREADS, Camera, Counters, GpuStruct, INGEST_THREADS, Push,
    SORT_THREADS, Slice, TEXELS,
};

/// Kernels by stage name.
pub const STAGES: &[&str] =
    &["ingest", "enhance", "carry", "cross", "sort", "merge", "gather", "event_frame", "voxel_grid"];

/// Threads of a stage's workgroup: what the number of workgroups in a dispatch is worked out for.
fn threads(stage: &str) -> u32 {
    match stage {
        // A pixel of a strip, or of a part of it, each.
        "cross" => CROSS_THREADS,
        "ingest" | "enhance" => INGEST_THREADS,
        "sort" => SORT_THREADS,
        _ => 256,
    }
}

/// Every offset, slot and stride in a kernel that was not optimised is the one that Rust uses; else
/// the difference in words. (The optimiser strips the names that this needs.)
pub fn check(stage: &str, words: &[u32]) -> Result<(), String> {
    let reflection = esaac_kernels::reflect(words).map_err(|e| e.to_string())?;
    for binding in &reflection.bindings {
        let expected = BINDINGS
            .get(binding.slot as usize)
            .ok_or_else(|| format!("binding {} is in no list", binding.slot))?;
        let stride = binding.stride.unwrap_or(0);
        if stride != expected.stride {
            return Err(format!("`{}` has stride {stride}, expected {}", expected.name, expected.stride));
        }
    }
    for (&slot, name) in &reflection.texels {
        let expected = TEXELS.iter().find(|t| t.slot == slot).map(|t| t.name);
        same(&format!("texel buffer {slot}"), Some(name.as_str()), expected)?;
    }
    // A kernel walks the table of cameras, or the packets that they left.
    if reflection.structs.contains_key(Slice::NAME) {
        check_struct::<Slice>(&reflection)?;
    } else {
        let table = reflection.uniform_strides.get(&(CAMERAS as u32)).copied();
        same("stride of `cameras`", table, Some(size_of::<Camera>() as u32))?;
        check_struct::<Camera>(&reflection)?;
    }
    same("workgroup", reflection.workgroup, [threads(stage), 1, 1])?;
    same("push constants", reflection.push_bytes, size_of::<Push>() as u32)?;
    check_struct::<Push>(&reflection)?;
    if reflection.bindings.iter().any(|b| b.slot as usize == COUNTERS) {
        check_struct::<Counters>(&reflection)?;
    }
    Ok(())
}

fn check_struct<T: GpuStruct>(reflection: &Reflection) -> Result<(), String> {
    let members =
        reflection.structs.get(T::NAME).ok_or_else(|| format!("no struct {} with offsets", T::NAME))?;
    let actual: Vec<(&str, usize)> = members.iter().map(|m| (m.name.as_str(), m.offset as usize)).collect();
    let expected: Vec<(&str, usize)> = T::FIELDS.iter().map(|&(name, _, offset)| (name, offset)).collect();
    same(&format!("members of {}", T::NAME), actual, expected)
}

fn same<T: PartialEq + std::fmt::Debug>(what: &str, actual: T, expected: T) -> Result<(), String> {
    if actual == expected { Ok(()) } else { Err(format!("{what}: {actual:?}, expected {expected:?}")) }
}
