//! Tiles that show what they did in the frame before keep its surfaces and lists.

use super::input::changed;
use super::levels::{SIZE, check_frames, sensor};
use super::stages::{lists_of, run_by};
use esaac_engine::KernelPolicy;
use esaac_model::substeps::BLOCK_PX;
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::geometry::{KeyFrame, Rendered};

const POLICIES: [Option<KernelPolicy>; 2] = [None, Some(KernelPolicy::gpu())];

/// A propeller before a slanted wall and behind a still post: the post's silhouettes lie in tiles that the blades pass, and
/// in some that they do not.
pub(super) fn behind_a_post() -> Rendered {
    let mut rendered = Rendered::of(SceneKind::Propeller, SIZE, 4);
    let columns = SIZE.0 as usize;
    for frame in &mut rendered.frames {
        *frame = changed(frame, |pixel, depth, id| {
            let column = pixel % columns;
            if (68..72).contains(&column) {
                (*depth, *id) = (0.5, 0);
            } else if *id == 0 {
                *depth /= 1.0 + 0.004 * column as f32;
            }
        });
    }
    rendered
}

/// Tiles, with the two pixels around, in which two frames show the same still surfaces.
fn still_tiles(before: &KeyFrame, last: &KeyFrame) -> Vec<(usize, usize)> {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let around =
        |first: usize, length: usize, all: usize| first.saturating_sub(2)..(first + length + 2).min(all);
    let same = |pixel: usize| {
        let of = |image: &[u8]| image[4 * pixel..][..4].to_vec();
        of(&before.depth) == of(&last.depth) && of(&before.ids) == of(&last.ids) && of(&last.ids) == [0; 4]
    };
    let tiles =
        (0..height).step_by(BLOCK_PX as usize).flat_map(|y| (0..width).step_by(32).map(move |x| (x, y)));
    tiles
        .filter(|&(x, y)| {
            around(y, BLOCK_PX as usize, height)
                .all(|row| around(x, 32, width).all(|column| same(row * width + column)))
        })
        .collect()
}

/// Surfaces, slopes and lists of the last frame of a run.
fn found(rendered: &Rendered, policy: Option<KernelPolicy>) -> (Vec<u32>, Vec<u32>, Vec<Vec<u32>>) {
    let rig = run_by(rendered, &sensor(), policy);
    // A rig's first frame is in slot 0, so the fourth is in slot 1.
    let last = |name: &str| {
        let words = rig.words(0, name).expect("a rig that is well");
        words[words.len() / 2..].to_vec()
    };
    let mut lists = lists_of(&rig);
    let found = (last("surfaces"), last("slopes"), lists.split_off(lists.len() / 2));
    drop(rig);
    assert_silent();
    found
}

#[test]
fn kept_surfaces_and_lists_are_those_that_are_found_anew() {
    let rendered = behind_a_post();
    let still = still_tiles(&rendered.frames[2], &rendered.frames[3]);
    let at_the_post = still.iter().filter(|tile| tile.0 == 64).count();
    assert!(at_the_post > 0 && at_the_post < still.len(), "{at_the_post} of {} still tiles", still.len());
    assert!(still.len() < 21, "the blades are seen");
    // With another depth in the frame before, nothing can be kept.
    let mut anew = rendered.clone();
    anew.frames[2] = changed(&rendered.frames[2], |_, depth, _| *depth *= 1.01);
    for policy in POLICIES {
        let (kept, anew) = (found(&rendered, policy), found(&anew, policy));
        assert!(kept.0 == anew.0, "surfaces");
        assert!(kept.1 == anew.1, "slopes");
        assert_eq!(kept.2, anew.2, "representatives");
    }
}

#[test]
fn what_moves_behind_a_still_thing_is_the_oracles() {
    let rendered = behind_a_post();
    for policy in POLICIES {
        check_frames(&sensor(), &[(SceneKind::Propeller, rendered.clone())], policy, false);
    }
}
