//! Compilation with the shaderc project's compiler linked into the program: without a process, from sources in memory.

use crate::precise::precise;
use crate::{CompileError, Optimise};
use shaderc::{
    CompileOptions, Compiler, EnvVersion, OptimizationLevel, ResolvedInclude, ShaderKind, TargetEnv,
};
use std::path::Path;

/// The file of an `#include` directive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Include {
    /// Its name in the compiler's messages.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// Compiles a compute kernel from memory, as [`crate::compile`] does from a file. `name` is its name in the compiler's
/// messages; `include` returns the file of an `#include` directive, or the reason why there is none.
pub fn compile_linked(
    source: &str,
    name: &str,
    include: impl Fn(&str) -> Result<Include, String>,
    optimise: Optimise,
) -> Result<Vec<u32>, CompileError> {
    let refused = |message: String| CompileError::Source { path: Path::new(name).to_owned(), message };
    let unusable = |error: shaderc::Error| CompileError::NoLinkedCompiler(error.to_string());
    if source.contains('\0') {
        return Err(refused(format!("{name}: a zero byte in the source")));
    }
    let compiler = Compiler::new().map_err(unusable)?;
    let mut options = CompileOptions::new().map_err(unusable)?;
    // `TARGET_ENV`, and the flags that `compile` gives to `glslc`.
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_2 as u32);
    options.set_warnings_as_errors();
    options.set_optimization_level(match optimise {
        Optimise::Yes => OptimizationLevel::Performance,
        Optimise::No => OptimizationLevel::Zero,
    });
    options.set_include_callback(|wanted, _, _, _| {
        let Include { name, text } = include(wanted)?;
        if text.contains('\0') {
            return Err(format!("{name}: a zero byte in the source"));
        }
        Ok(ResolvedInclude { resolved_name: name, content: text })
    });
    let artifact = compiler
        .compile_into_spirv(source, ShaderKind::Compute, name, "main", Some(&options))
        .map_err(|error| match error {
            shaderc::Error::CompilationError(_, message) => refused(message.trim_end().to_owned()),
            other => refused(other.to_string()),
        })?;
    precise(artifact.as_binary()).map_err(|message| CompileError::Unreadable { path: name.into(), message })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflect;

    const SOURCE: &str = "#version 460\n#extension GL_GOOGLE_include_directive : require\n\
        #include \"size.glsl\"\nlayout(local_size_x = SIZE) in;\n\
        layout(std430, binding = 3) buffer Values { uint values[]; };\n\
        void main() { values[gl_GlobalInvocationID.x] = SIZE; }\n";

    fn size(text: &str) -> impl Fn(&str) -> Result<Include, String> {
        move |wanted| match wanted {
            "size.glsl" => Ok(Include { name: "memory/size.glsl".to_owned(), text: text.to_owned() }),
            other => Err(format!("no {other}")),
        }
    }

    #[test]
    fn a_source_and_an_include_from_memory_become_a_kernel() {
        let words =
            compile_linked(SOURCE, "k.comp", size("#define SIZE 32\n"), Optimise::No).expect("compiles");
        let reflection = reflect(&words).expect("reads back");
        assert_eq!(reflection.workgroup, [32, 1, 1]);
        assert_eq!((reflection.bindings[0].slot, reflection.bindings[0].stride), (3, Some(4)));
        let optimised = compile_linked(SOURCE, "k.comp", size("#define SIZE 32\n"), Optimise::Yes);
        assert!(optimised.expect("compiles").len() < words.len());
    }

    #[test]
    fn an_error_names_the_file_and_the_line_it_is_in() {
        let message = |source: &str, text: &str| {
            compile_linked(source, "k.comp", size(text), Optimise::No).expect_err("wrong").to_string()
        };
        let broken = SOURCE.replace("void main", "void main(");
        assert!(message(&broken, "#define SIZE 32\n").contains("k.comp:6:"));
        assert!(message(SOURCE, "\n#define SIZE 32\nint f() { return; }\n").contains("memory/size.glsl:3:"));
        assert!(message(&SOURCE.replace("size.glsl", "none.glsl"), "").contains("no none.glsl"));
        assert!(message("\0", "").contains("zero byte"));
    }
}
