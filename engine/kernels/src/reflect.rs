//! A kernel's interface, read back from its SPIR-V.

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Dim, ExecutionMode, Op, StorageClass};
use std::collections::BTreeMap;
use thiserror::Error;

/// The SPIR-V cannot be read.
#[derive(Debug, Error)]
#[error("SPIR-V cannot be parsed: {0}")]
pub struct ReflectionError(String);

/// A storage-buffer binding of descriptor set 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Slot.
    pub slot: u32,
    /// Variable or block name.
    pub name: String,
    /// Stride of the runtime array in it, bytes.
    pub stride: Option<u32>,
    /// Declared `readonly`.
    pub readonly: bool,
}

/// A member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Name.
    pub name: String,
    /// Byte offset.
    pub offset: u32,
}

/// A specialisation constant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Specialisation {
    /// Name; empty if the constant is the size of a workgroup.
    pub name: String,
    /// Type in GLSL: `bool`, `uint`, or `other`.
    pub ty: &'static str,
}

/// The interface of a kernel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reflection {
    /// Workgroup size, specialisation constants at their defaults.
    pub workgroup: [u32; 3],
    /// Bindings by slot.
    pub bindings: Vec<Binding>,
    /// Structs that have offsets, by name.
    pub structs: BTreeMap<String, Vec<Member>>,
    /// Specialisation constants by id.
    pub specialisation: BTreeMap<u32, Specialisation>,
    /// Bytes of push constants.
    pub push_bytes: u32,
    /// Strides of the arrays in uniform buffers, by slot.
    pub uniform_strides: BTreeMap<u32, u32>,
    /// Names of uniform texel buffers, by slot.
    pub texels: BTreeMap<u32, String>,
}

/// Reads a module's interface.
pub fn reflect(words: &[u32]) -> Result<Reflection, ReflectionError> {
    let module = rspirv::dr::load_words(words).map_err(|e| ReflectionError(e.to_string()))?;
    let names = Names::new(&module);
    let mut reflection = Reflection { workgroup: workgroup(&module), ..Reflection::default() };
    for (&id, _) in names.types.iter().filter(|(_, i)| i.class.opcode == Op::TypeStruct) {
        let members = names.members(id);
        if !members.is_empty() {
            reflection.structs.insert(names.name(id), members);
        }
    }
    for variable in &module.types_global_values {
        if variable.class.opcode != Op::Variable {
            continue;
        }
        let (Some(id), Some(pointer)) = (variable.result_id, variable.result_type) else { continue };
        let Some(block) = names.types.get(&pointer).and_then(|p| id_operand(p, 1)) else { continue };
        match variable.operands.first() {
            Some(Operand::StorageClass(StorageClass::StorageBuffer)) => {
                let Some(slot) = names.literal(id, Decoration::Binding) else { continue };
                let name = if names.name(id).is_empty() { names.name(block) } else { names.name(id) };
                reflection.bindings.push(Binding {
                    slot,
                    name,
                    stride: names.array_stride(block),
                    readonly: names.has(id, Decoration::NonWritable) || names.all_members_readonly(block),
                });
            }
            Some(Operand::StorageClass(StorageClass::Uniform)) => {
                if let (Some(slot), Some(stride)) =
                    (names.literal(id, Decoration::Binding), names.array_stride(block))
                {
                    reflection.uniform_strides.insert(slot, stride);
                }
            }
            Some(Operand::StorageClass(StorageClass::UniformConstant)) if names.is_texel_buffer(block) => {
                if let Some(slot) = names.literal(id, Decoration::Binding) {
                    reflection.texels.insert(slot, names.name(id));
                }
            }
            Some(Operand::StorageClass(StorageClass::PushConstant)) => {
                reflection.push_bytes = names.members(block).last().map_or(0, |m| m.offset + 4);
            }
            _ => {}
        }
    }
    reflection.bindings.sort_by_key(|b| b.slot);
    for (id, spec) in &names.decorations {
        for (decoration, literal) in spec {
            if *decoration == Decoration::SpecId {
                let constant = Specialisation { name: names.name(*id), ty: constant_type(&module, *id) };
                reflection.specialisation.insert(literal.unwrap_or(u32::MAX), constant);
            }
        }
    }
    Ok(reflection)
}

/// A decoration with its literal, if it has one.
type Decorations = Vec<(Decoration, Option<u32>)>;

struct Names<'a> {
    names: BTreeMap<u32, String>,
    member_names: BTreeMap<(u32, u32), String>,
    decorations: BTreeMap<u32, Decorations>,
    member_decorations: BTreeMap<(u32, u32), Decorations>,
    types: BTreeMap<u32, &'a Instruction>,
}

impl<'a> Names<'a> {
    fn new(module: &'a Module) -> Self {
        let mut this = Names {
            names: BTreeMap::new(),
            member_names: BTreeMap::new(),
            decorations: BTreeMap::new(),
            member_decorations: BTreeMap::new(),
            types: BTreeMap::new(),
        };
        for i in &module.debug_names {
            match (i.class.opcode, &i.operands[..]) {
                (Op::Name, [Operand::IdRef(id), Operand::LiteralString(name)]) => {
                    this.names.insert(*id, name.clone());
                }
                (
                    Op::MemberName,
                    [Operand::IdRef(id), Operand::LiteralBit32(member), Operand::LiteralString(name)],
                ) => {
                    this.member_names.insert((*id, *member), name.clone());
                }
                _ => {}
            }
        }
        for i in &module.annotations {
            let literal = |operands: &[Operand]| match operands.first() {
                Some(Operand::LiteralBit32(value)) => Some(*value),
                _ => None,
            };
            match (i.class.opcode, &i.operands[..]) {
                (Op::Decorate, [Operand::IdRef(id), Operand::Decoration(d), rest @ ..]) => {
                    this.decorations.entry(*id).or_default().push((*d, literal(rest)));
                }
                (
                    Op::MemberDecorate,
                    [Operand::IdRef(id), Operand::LiteralBit32(member), Operand::Decoration(d), rest @ ..],
                ) => {
                    this.member_decorations.entry((*id, *member)).or_default().push((*d, literal(rest)));
                }
                _ => {}
            }
        }
        for i in &module.types_global_values {
            if let Some(id) = i.result_id {
                this.types.insert(id, i);
            }
        }
        this
    }

    fn name(&self, id: u32) -> String {
        self.names.get(&id).cloned().unwrap_or_default()
    }

    fn has(&self, id: u32, decoration: Decoration) -> bool {
        self.decorations.get(&id).is_some_and(|all| all.iter().any(|(d, _)| *d == decoration))
    }

    fn literal(&self, id: u32, decoration: Decoration) -> Option<u32> {
        self.decorations.get(&id)?.iter().find(|(d, _)| *d == decoration)?.1
    }

    fn members(&self, id: u32) -> Vec<Member> {
        self.member_decorations
            .range((id, 0)..=(id, u32::MAX))
            .filter_map(|(key, all)| {
                let offset = all.iter().find(|(d, _)| *d == Decoration::Offset)?.1?;
                Some(Member { name: self.member_names.get(key).cloned().unwrap_or_default(), offset })
            })
            .collect()
    }

    fn all_members_readonly(&self, id: u32) -> bool {
        let mut members = self.member_decorations.range((id, 0)..=(id, u32::MAX)).peekable();
        members.peek().is_some()
            && members.all(|(_, all)| all.iter().any(|(d, _)| *d == Decoration::NonWritable))
    }

    fn is_texel_buffer(&self, id: u32) -> bool {
        self.types.get(&id).is_some_and(|i| {
            i.class.opcode == Op::TypeImage && i.operands.contains(&Operand::Dim(Dim::DimBuffer))
        })
    }

    fn array_stride(&self, block: u32) -> Option<u32> {
        self.types
            .get(&block)?
            .operands
            .iter()
            .filter_map(|o| match o {
                Operand::IdRef(id) => Some(*id),
                _ => None,
            })
            .find_map(|member| self.literal(member, Decoration::ArrayStride))
    }
}

/// Type of a specialisation constant, in GLSL.
fn constant_type(module: &Module, id: u32) -> &'static str {
    let with_id = |id| module.types_global_values.iter().find(|i| i.result_id == Some(id));
    let ty = with_id(id).and_then(|constant| constant.result_type).and_then(with_id);
    match ty.map(|ty| (ty.class.opcode, &ty.operands[..])) {
        Some((Op::TypeBool, _)) => "bool",
        Some((Op::TypeInt, [Operand::LiteralBit32(32), Operand::LiteralBit32(0)])) => "uint",
        _ => "other",
    }
}

fn id_operand(instruction: &Instruction, index: usize) -> Option<u32> {
    match instruction.operands.get(index) {
        Some(Operand::IdRef(id)) => Some(*id),
        _ => None,
    }
}

/// The workgroup size: an execution mode, or the constant decorated as such when it is specialised.
fn workgroup(module: &Module) -> [u32; 3] {
    for mode in &module.execution_modes {
        if let [_, Operand::ExecutionMode(ExecutionMode::LocalSize), size @ ..] = &mode.operands[..]
            && let [Operand::LiteralBit32(x), Operand::LiteralBit32(y), Operand::LiteralBit32(z)] = size
        {
            return [*x, *y, *z];
        }
    }
    let is_workgroup = |i: &&Instruction| {
        i.class.opcode == Op::Decorate
            && i.operands.contains(&Operand::Decoration(Decoration::BuiltIn))
            && i.operands.contains(&Operand::BuiltIn(BuiltIn::WorkgroupSize))
    };
    let Some(composite) = module
        .annotations
        .iter()
        .find(is_workgroup)
        .and_then(|i| id_operand(i, 0))
        .and_then(|id| module.types_global_values.iter().find(|v| v.result_id == Some(id)))
    else {
        return [0; 3];
    };
    std::array::from_fn(|axis| {
        id_operand(composite, axis)
            .and_then(|id| module.types_global_values.iter().find(|v| v.result_id == Some(id)))
            .and_then(|constant| match constant.operands.first() {
                Some(Operand::LiteralBit32(value)) => Some(*value),
                _ => None,
            })
            .unwrap_or(0)
    })
}
