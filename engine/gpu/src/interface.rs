//! Checks that the reflection of each kernel agrees with the layouts that Rust uses. The build script checks the
//! kernels that it embeds, a kernel folder those that it compiles.

use esaac_kernels::Reflection;
use esaac_layout::{
    BINDINGS, CAMERAS, COUNTERS, Camera, Counters, GEOMETRIES, Geometry, GpuStruct, KernelInfo, OPTICS,
    Optics, PHYSICALS, Physical, PoseSegment, Push, READOUTS, RESTS, Readout, Rest, Slice, TEXELS, Track,
};
use std::collections::BTreeMap;

/// Checks every offset, slot and stride of a kernel against the one that Rust uses; the error describes the first
/// difference. The kernel must not be optimised: the optimiser removes the names that the check needs.
pub fn check(kernel: &KernelInfo, words: &[u32]) -> Result<(), String> {
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
    // A kernel reads the table of cameras or, if it works on packets, the slices of them.
    if reflection.structs.contains_key(Slice::NAME) {
        check_struct::<Slice>(&reflection)?;
    } else {
        let table = reflection.uniform_strides.get(&(CAMERAS as u32)).copied();
        same("stride of `cameras`", table, Some(size_of::<Camera>() as u32))?;
        check_struct::<Camera>(&reflection)?;
        let table = reflection.uniform_strides.get(&(GEOMETRIES as u32)).copied();
        same("stride of `geometries`", table, Some(size_of::<Geometry>() as u32))?;
        check_struct::<Geometry>(&reflection)?;
    }
    if reflection.structs.contains_key(PoseSegment::NAME) {
        check_struct::<Track>(&reflection)?;
        check_struct::<PoseSegment>(&reflection)?;
    }
    if reflection.structs.contains_key(Physical::NAME) {
        let table = reflection.uniform_strides.get(&(PHYSICALS as u32)).copied();
        same("stride of `physicals`", table, Some(size_of::<Physical>() as u32))?;
        check_struct::<Physical>(&reflection)?;
    }
    if reflection.structs.contains_key(Readout::NAME) {
        let table = reflection.uniform_strides.get(&(READOUTS as u32)).copied();
        same("stride of `readouts`", table, Some(size_of::<Readout>() as u32))?;
        check_struct::<Readout>(&reflection)?;
    }
    if reflection.structs.contains_key(Optics::NAME) {
        let table = reflection.uniform_strides.get(&(OPTICS as u32)).copied();
        same("stride of `optics`", table, Some(size_of::<Optics>() as u32))?;
        check_struct::<Optics>(&reflection)?;
    }
    if reflection.structs.contains_key(Rest::NAME) {
        let table = reflection.uniform_strides.get(&(RESTS as u32)).copied();
        same("stride of `rests`", table, Some(size_of::<Rest>() as u32))?;
        check_struct::<Rest>(&reflection)?;
    }
    same("workgroup", reflection.workgroup, [kernel.threads, 1, 1])?;
    check_constants(kernel, &reflection)?;
    same("push constants", reflection.push_bytes, size_of::<Push>() as u32)?;
    check_struct::<Push>(&reflection)?;
    if reflection.bindings.iter().any(|b| b.slot as usize == COUNTERS) {
        check_struct::<Counters>(&reflection)?;
    }
    Ok(())
}

/// Checks that the kernel declares every specialisation constant of its lists with its id, name and type, and no
/// other.
fn check_constants(kernel: &KernelInfo, reflection: &Reflection) -> Result<(), String> {
    let actual: BTreeMap<u32, (&str, &str)> = reflection
        .specialisation
        .iter()
        .map(|(&id, constant)| (id, (constant.name.as_str(), constant.ty)))
        .collect();
    let names: Vec<(u32, String, &str)> = kernel
        .constants
        .iter()
        .flat_map(|list| list.constants)
        .map(|c| (c.id, c.glsl_name().unwrap_or_default(), c.ty.glsl()))
        .collect();
    let expected = names.iter().map(|(id, name, ty)| (*id, (name.as_str(), *ty))).collect();
    same("specialisation constants", actual, expected)
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
