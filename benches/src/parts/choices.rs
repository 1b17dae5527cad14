//! The engine's choices for the synthesis between two frames.

use esaac_model::synthesis::TRANSFERS_BY_VECTORS;
use esaac_model::{SensorModel, SubstepPolicy, Synthesis, Taps, Timestamps};

/// One choice.
pub(super) struct Choice {
    pub name: String,
    pub family: &'static str,
    pub sensor: SensorModel,
    /// Whether its frames are f32, not f16.
    pub wide: bool,
    /// Whether it is what `auto` is for frames with motion vectors, and the default otherwise.
    pub is_default: bool,
}

/// Every choice, for one sensor; with exact paths if there are `poses`.
pub(super) fn choices(base: &SensorModel, quick: bool, poses: bool) -> Vec<Choice> {
    let mut choices = Vec::new();
    // The file of a sequence names the choices of its time.
    let base = &SensorModel { layers: SensorModel::default().layers, ..base.clone() };
    let counts: &[u32] = if quick { &[8, 32] } else { &[1, 2, 4, 8, 16, 32, 64] };
    let most: &[u32] = if quick { &[32] } else { &[8, 16, 32, 64] };
    let mut add = |name: String, family: &'static str, sensor: SensorModel, wide: bool| {
        let synthesis = base.synthesis.resolve(false, true);
        let of_vectors = SensorModel { synthesis, transfers: TRANSFERS_BY_VECTORS, ..base.clone() };
        let is_default = !wide && sensor == of_vectors;
        choices.push(Choice { name, family, sensor, wide, is_default });
    };
    let with = |synthesis, taps, transfers, substeps, substep_policy| SensorModel {
        synthesis,
        taps,
        transfers,
        substeps,
        substep_policy,
        ..base.clone()
    };
    let (fixed, adaptive) = (SubstepPolicy::Fixed, SubstepPolicy::Adaptive);
    add("none".into(), "none", with(Synthesis::None, Taps::Cubic, 1, 1, fixed), false);
    let families = [
        ("linear", Synthesis::Linear, Taps::Cubic, 1),
        ("paper", Synthesis::Paper, Taps::Bilinear, 1),
        ("motion bilinear", Synthesis::Motion, Taps::Bilinear, 1),
        ("motion cubic, 1 transfer", Synthesis::Motion, Taps::Cubic, 1),
        ("motion cubic, 2 transfers", Synthesis::Motion, Taps::Cubic, 2),
        ("motion cubic, 3 transfers", Synthesis::Motion, Taps::Cubic, 3),
        ("rigid cubic, 1 transfer", Synthesis::Rigid, Taps::Cubic, 1),
        ("rigid cubic, 2 transfers", Synthesis::Rigid, Taps::Cubic, 2),
        ("rigid cubic, 3 transfers", Synthesis::Rigid, Taps::Cubic, 3),
    ];
    let given = |synthesis| poses || synthesis != Synthesis::Rigid;
    for (family, synthesis, taps, transfers) in families.into_iter().filter(|of| given(of.1)) {
        for &n in counts {
            let name = format!("{family}, fixed {n}");
            add(name, family, with(synthesis, taps, transfers, n, fixed), false);
        }
        for &n in most {
            let name = format!("{family}, adaptive {n}");
            add(name, family, with(synthesis, taps, transfers, n, adaptive), false);
        }
    }
    // What differs from the default in nothing else.
    let motion = |policy| with(Synthesis::Motion, Taps::Cubic, TRANSFERS_BY_VECTORS, 32, policy);
    let at_sample = |sensor: SensorModel| SensorModel { timestamps: Timestamps::AtSample, ..sensor };
    for (name, sensor) in [
        ("paper, fixed 32, at sample", with(Synthesis::Paper, Taps::Bilinear, 1, 32, fixed)),
        ("motion cubic, fixed 32, at sample", motion(fixed)),
        ("motion cubic, adaptive 32, at sample", motion(adaptive)),
    ] {
        add(name.into(), "times at samples", at_sample(sensor), false);
    }
    for (policy_name, policy) in [("fixed", fixed), ("adaptive", adaptive)] {
        for (layers, family, told) in [(1, "motion, 1 layer", "1 layer"), (3, "motion, 3 layers", "3 layers")]
        {
            let name = format!("motion cubic, {told}, {policy_name} 32");
            add(name, family, SensorModel { layers, ..motion(policy) }, false);
        }
        let name = format!("motion cubic, {policy_name} 32, f32 input");
        add(name, "f32 input", motion(policy), true);
    }
    choices
}
