//! The value of `--scene`.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use esaac_scene::SceneKind;

/// Accepts the names of the built-in scenes; the help text describes each one.
pub fn scene_parser() -> impl TypedValueParser<Value = SceneKind> {
    PossibleValuesParser::new(SceneKind::ALL.map(|kind| PossibleValue::new(kind.name()).help(kind.about())))
        .try_map(|name| name.parse::<SceneKind>())
}
