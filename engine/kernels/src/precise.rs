//! Makes arithmetic the same in every kernel.
//!
//! A driver may fuse a multiplication and an addition, depending on the code around them. Then one permutation of a
//! kernel would stamp a pixel's event a nanosecond earlier than another, and which of them walks the pixel may depend
//! on how full a buffer is. `NoContraction` forbids it; where kernels want a fused operation, they call `fma`.

use rspirv::binary::Assemble;
use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op};

/// Decorates all floating-point arithmetic of a module with `NoContraction`. Returns the module's words, or why it
/// cannot be read.
pub(crate) fn precise(words: &[u32]) -> Result<Vec<u32>, String> {
    let mut module: Module = rspirv::dr::load_words(words).map_err(|e| e.to_string())?;
    let decorated: Vec<Instruction> = module
        .all_inst_iter()
        .filter(|i| is_arithmetic(i.class.opcode))
        .filter_map(|i| i.result_id)
        .map(|id| {
            let operands = vec![Operand::IdRef(id), Operand::Decoration(Decoration::NoContraction)];
            Instruction::new(Op::Decorate, None, None, operands)
        })
        .collect();
    module.annotations.extend(decorated);
    Ok(module.assemble())
}

fn is_arithmetic(opcode: Op) -> bool {
    matches!(
        opcode,
        Op::FAdd
            | Op::FSub
            | Op::FMul
            | Op::FDiv
            | Op::FRem
            | Op::FMod
            | Op::FNegate
            | Op::VectorTimesScalar
            | Op::Dot
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Optimise, compile};

    #[test]
    fn every_sum_and_product_stays_as_it_is_written() {
        let source = std::env::temp_dir().join(format!("precise-{}.comp", std::process::id()));
        let text = "#version 460\nlayout(local_size_x = 1) in;\n\
            layout(std430, binding = 0) buffer Values { float values[]; };\n\
            void main() { values[0] = values[1] * values[2] + values[3] / values[4]; }\n";
        std::fs::write(&source, text).expect("a writable folder");
        let words = compile(&source, &[], &[], Optimise::No).expect("compiles");
        std::fs::remove_file(&source).expect("it is there");
        let module = rspirv::dr::load_words(words).expect("reads back");
        let decorations = module
            .annotations
            .iter()
            .filter(|i| i.operands.get(1) == Some(&Operand::Decoration(Decoration::NoContraction)))
            .count();
        assert_eq!(decorations, 3);
    }
}
