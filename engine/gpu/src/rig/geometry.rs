//! Where each camera's data lie in the rig's buffers.

use super::sensor::{has_bus, is_rigid, makes_levels, plane_words};
use super::{CameraConfig, RigOptions};
use crate::policy::{KernelPolicy, KernelSet};
use esaac_layout::{
    self as layout, BINDINGS, BUS_HEAD, BUS_KEPT_ROW, BUS_ROW, BUS_STRETCH, LIST_ROWS, MOST_CARRIED,
    MOST_PASSES, PASSING_ENTRIES, PASSING_HEAD_WORDS, POSE_ROWS, REPRESENTATIVE_WORDS, SORTABLE_EVENTS,
    STATE_WORDS, SUB_TILES, SUMMED_BINS, TILE_BLOCKS,
};
use esaac_model::SensorModel;
use esaac_model::substeps::{BLOCK_PX, MAX_SUBSTEPS};

/// A camera's sizes and its parts of the rig's buffers; bases and capacities are in elements of the buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub slot: u32,
    pub pixels: u32,
    pub height: u32,
    /// Words of `planes` that a frame takes, over all colour components.
    pub plane_words: u32,
    pub blocks_x: u32,
    pub blocks: u32,
    pub tiles: u32,
    pub bin_count: u32,
    pub bin_capacity: u32,
    pub event_capacity: u32,
    pub plane_base: u32,
    pub motion_base: u32,
    pub state_base: u32,
    pub block_base: u32,
    pub bin_base: u32,
    pub bin_storage_base: u32,
    pub event_base: u32,
    pub aps_base: u32,
    pub tile_base: u32,
    pub surface_base: u32,
    pub representative_base: u32,
    pub passing_base: u32,
    pub instance_base: u32,
    pub pose_base: u32,
    pub path_base: u32,
    pub track_base: u32,
    pub bus_base: u32,
    /// Rows of `levels` that an interval needs at most; 0 if `cross` synthesises by itself.
    pub level_rows: u32,
    /// Rows of instances that there is room for; 0 without synthesis `rigid`.
    pub instances: u32,
    /// Instants of sub-steps that an instance has room for in `paths`.
    pub path_instants: u32,
    has_motion: bool,
    /// Whether there is room for what synthesis `rigid` keeps.
    is_rigid: bool,
    /// Whether there is room for a bus, and an outlet.
    pub has_bus: bool,
}

impl Place {
    /// Elements of each buffer that this camera takes, in the order of the slots; `None` for shared buffers.
    pub(super) fn elements(&self) -> [Option<u64>; BINDINGS.len()] {
        let mut elements = [None; BINDINGS.len()];
        let pixels = u64::from(self.pixels);
        elements[layout::PLANES] = Some(2 * u64::from(self.plane_words));
        elements[layout::MOTION] = Some(if self.has_motion { 2 * pixels } else { 0 });
        elements[layout::STATE] = Some(u64::from(STATE_WORDS) * pixels);
        elements[layout::BLOCKS] = Some(2 * u64::from(self.blocks));
        elements[layout::BINS] =
            // Two sets of bins, a place for each bin, two words for each chunk that is summed, and the list of crowded
            // sub-tiles: a slot of its own would be one more than the software driver has with instrumented shaders.
            Some(match u64::from(self.bin_count) {
                0 => 0,
                bins => {
                    let chunks = bins.div_ceil(u64::from(SUMMED_BINS));
                    2 * (bins + 1) + bins + 2 * chunks + u64::from(SUB_TILES * self.tiles)
                }
            });
        elements[layout::BIN_STORAGE] = Some(u64::from(self.bin_count) * u64::from(self.bin_capacity));
        for slot in [
            layout::OVERFLOW,
            layout::GATHERED,
            layout::EVENT_T,
            layout::EVENT_X,
            layout::EVENT_Y,
            layout::EVENT_P,
        ] {
            elements[slot] = Some(u64::from(self.event_capacity));
        }
        // For each element of `blocks`, at the same place.
        elements[layout::MEETINGS] = Some(2 * u64::from(self.blocks));
        elements[layout::TILE_ORDER] = Some(u64::from(self.tiles));
        // For each element of `tile_order`, at the same place.
        elements[layout::LEVEL_WORDS] = Some(u64::from(self.tiles));
        let (rigid, blocks) = (u64::from(self.is_rigid), u64::from(self.blocks));
        elements[layout::SURFACES] = Some(rigid * 2 * pixels);
        elements[layout::SLOPES] = Some(rigid * 2 * pixels);
        elements[layout::REPRESENTATIVES] = Some(rigid * 2 * blocks * u64::from(REPRESENTATIVE_WORDS));
        elements[layout::PASSING] =
            Some(rigid * blocks * u64::from(2 * PASSING_HEAD_WORDS + PASSING_ENTRIES));
        let instances = rigid * u64::from(self.instances);
        elements[layout::INSTANCES] = Some(instances);
        elements[layout::POSES] = Some(instances * u64::from(POSE_ROWS));
        // The camera's own track too.
        elements[layout::TRACKS] = Some(rigid * (1 + u64::from(self.instances)));
        elements[layout::PATHS] = Some(3 * instances * u64::from(self.path_instants));
        elements[layout::APS] = Some(pixels.next_multiple_of(8));
        let stretches = u64::from(self.event_capacity.div_ceil(LEAST_STRETCH));
        let bus = u64::from(BUS_HEAD)
            + pixels
            + u64::from(BUS_ROW) * u64::from(self.height)
            + u64::from(BUS_STRETCH) * stretches;
        elements[layout::BUS] = Some(u64::from(self.has_bus) * bus);
        elements
    }

    /// First element of this camera's part of a buffer that outlives a tick or that tests read.
    pub(super) fn first_element(&self, slot: usize) -> u64 {
        u64::from(match slot {
            layout::COUNTERS => 2 * self.slot,
            layout::PLANES => self.plane_base,
            layout::MOTION => self.motion_base,
            layout::STATE => self.state_base,
            layout::BLOCKS => self.block_base,
            layout::GATHERED => self.event_base,
            layout::SURFACES | layout::SLOPES => self.surface_base,
            layout::REPRESENTATIVES => self.representative_base,
            layout::PASSING => self.passing_base,
            layout::POSES => self.pose_base,
            layout::PATHS => self.path_base,
            layout::LEVEL_WORDS => self.tile_base,
            layout::BUS => self.bus_base,
            _ => unreachable!("`{}` is not read back", BINDINGS[slot].name),
        })
    }

    /// Elements of this camera's part that belong to the state of `sensor`. The part may be larger: planes do not
    /// shrink.
    pub(super) fn kept_elements(&self, slot: usize, sensor: &SensorModel) -> u64 {
        match slot {
            layout::PLANES => 2 * u64::from(plane_words(sensor)),
            layout::SURFACES | layout::SLOPES | layout::REPRESENTATIVES if !is_rigid(sensor) => 0,
            layout::BUS if !has_bus(sensor) => 0,
            layout::BUS => {
                u64::from(BUS_HEAD + self.pixels) + u64::from(BUS_KEPT_ROW) * u64::from(self.height)
            }
            _ => self.elements()[slot].unwrap_or(0),
        }
    }

    /// This place with storage for at least `wanted` events, and a quarter more if it has to grow.
    pub(super) fn with_events(self, wanted: u32) -> Self {
        if wanted <= self.event_capacity {
            return self;
        }
        Place { event_capacity: round_events(wanted.saturating_add(wanted / 4)), ..self }
    }

    /// This place with bins that can hold the largest bin of a packet and a quarter more. The limit, beyond the initial
    /// capacity, is twice the event capacity for all bins together.
    pub(super) fn with_bins_of(self, largest_bin: u32) -> Self {
        let most = (2 * self.event_capacity / self.bin_count).max(BIN_CAPACITY);
        let room = largest_bin.saturating_add(largest_bin / 4).min(most).next_multiple_of(BIN_CAPACITY_STEP);
        Place { bin_capacity: self.bin_capacity.max(room), ..self }
    }

    /// Whether a packet of `events`, whose largest bin has `largest_bin` of them, asks for more bins: that bin is nearly more
    /// than `sort` takes, and the others have many too. More bins do not part what comes at one instant.
    pub(super) fn is_crowded(&self, largest_bin: u32, events: u32) -> bool {
        largest_bin > CROWDED_BIN && events / CROWDED_MEAN > self.bin_count
    }

    /// This place with twice the bins, with half the room in each.
    pub(super) fn with_more_bins(self) -> Self {
        let bin_capacity = self.bin_capacity.div_ceil(2).next_multiple_of(BIN_CAPACITY_STEP);
        Place { bin_count: 2 * self.bin_count, bin_capacity, ..self }
    }

    /// This place of an outlet with room for all that can leave the bus of the camera at `camera` in a tick: its events, and
    /// one of each pixel that waited. Without a bus there is no outlet.
    pub(super) fn behind(self, camera: &Place) -> Self {
        if !camera.has_bus {
            return self;
        }
        let mut bins = self;
        while bins.bin_count > 0 && bins.bin_count < camera.bin_count {
            bins = bins.with_more_bins();
        }
        Place {
            bin_count: camera.bin_count,
            bin_capacity: bins.bin_capacity.max(BIN_CAPACITY),
            event_capacity: round_events(camera.event_capacity.saturating_add(camera.pixels))
                .max(3 * MOST_CARRIED),
            ..self
        }
    }

    /// This place with planes at least as large as `sensor` needs, and room for what its synthesis and its readout keep.
    pub(super) fn with_planes_of(self, sensor: &SensorModel) -> Self {
        let instants = if is_rigid(sensor) { layout::path_instants(sensor.substeps) } else { 0 };
        let place = Place {
            plane_words: self.plane_words.max(plane_words(sensor)),
            is_rigid: self.is_rigid || is_rigid(sensor),
            has_bus: self.has_bus || has_bus(sensor),
            path_instants: self.path_instants.max(instants),
            ..self
        };
        if self.level_rows > 0 || makes_levels(sensor) { place.with_levels_of(sensor) } else { place }
    }

    /// This place with room for the levels of `sensor`'s intervals, made apart from the walks.
    pub(super) fn with_levels_of(self, sensor: &SensorModel) -> Self {
        let needed = self.blocks * (sensor.substeps.max(1) - 1 + LIST_ROWS);
        Place { level_rows: self.level_rows.max(needed), ..self }
    }

    /// This place with room for at least `wanted` rows of instances.
    pub(super) fn with_instances(self, wanted: u32) -> Self {
        let instances = if wanted > self.instances { wanted.next_power_of_two() } else { self.instances };
        Place { instances, ..self }
    }
}

/// Rows of `levels` that cameras share. Where an interval needs more, a tick takes several passes.
pub(super) fn shared_level_rows<'a>(places: impl Iterator<Item = &'a Place>, policy: KernelPolicy) -> u64 {
    LevelRows::of(places).shared(policy)
}

/// Passes of `synthesize` and `cross` after which each tile has had room in `levels`.
pub(super) fn level_passes<'a>(places: impl Iterator<Item = &'a Place>, policy: KernelPolicy) -> u32 {
    let rows = LevelRows::of(places);
    let shared = rows.shared(policy);
    if shared == 0 || rows.most <= shared {
        return 1;
    }
    // Every pass but the last fills the rows, up to those of a tile that finds no room.
    rows.most.div_ceil(shared - TILE_LEVEL_ROWS) as u32
}

/// What cameras could use of `levels`.
#[derive(Default)]
struct LevelRows {
    /// Rows that an interval needs at most.
    most: u64,
    /// Pixels of the cameras that use any.
    pixels: u64,
}

impl LevelRows {
    fn of<'a>(places: impl Iterator<Item = &'a Place>) -> Self {
        places.filter(|place| place.level_rows > 0).fold(LevelRows::default(), |sum, place| LevelRows {
            most: sum.most + u64::from(place.level_rows),
            pixels: sum.pixels + u64::from(place.pixels),
        })
    }

    fn shared(&self, policy: KernelPolicy) -> u64 {
        if policy.kernels != KernelSet::Gpu {
            return 0;
        }
        let wanted = (self.pixels / PIXELS_PER_LEVEL_ROW).max(u64::from(policy.least_level_rows));
        self.most.min(wanted.max(self.most.div_ceil(u64::from(MOST_PASSES)) + TILE_LEVEL_ROWS))
    }
}

/// Rows of `levels` that a tile takes at most.
pub(super) const TILE_LEVEL_ROWS: u64 = (TILE_BLOCKS * (MAX_SUBSTEPS - 1 + LIST_ROWS)) as u64;

/// Pixels of a rig's cameras for each row of `levels`: 16 bytes a pixel, less than a tenth of what a camera takes.
const PIXELS_PER_LEVEL_ROW: u64 = 16;

/// Events of the shortest stretches of `readout`, those of workgroups of 64 threads.
const LEAST_STRETCH: u32 = 32;

/// Most bins of a camera but for those of [`RANKED_PX`].
const MOST_BINS: u32 = 16_384;

/// Most pixels of an image whose bins are small enough to be ranked, not split, if there are [`RANKED_BINS`] of them. Those
/// of larger images are split in any case, which takes least time with few bins.
const RANKED_PX: u32 = 2 * MOST_BINS * BIN_PX;

/// Bins of the largest such images: four times as many, for a bin is at least one tick of the sensor's clock, and with
/// ticks of a microsecond half of them stay empty.
const RANKED_BINS: u32 = 4 * MOST_BINS;

/// Fewest bins of a camera. There may be many small cameras, and each bin takes memory.
const LEAST_BINS: u32 = 128;

/// Pixels per bin. A bin then usually has a few dozen events, which are cheap to rank.
const BIN_PX: u32 = 64;

/// Initial capacity of a bin: one and a half events for each of [`BIN_PX`] pixels.
const BIN_CAPACITY: u32 = BIN_PX + BIN_PX / 2;

/// Bin capacities are multiples of this: whole lines of memory.
const BIN_CAPACITY_STEP: u32 = 16;

/// Events of a bin from which on a camera takes more bins: three quarters of what `sort` takes.
const CROWDED_BIN: u32 = SORTABLE_EVENTS / 4 * 3;

/// Events that its bins have on average then, at least: four for each of [`BIN_PX`] pixels.
const CROWDED_MEAN: u32 = 4 * BIN_PX;

/// Number of bins of a camera, and their initial capacity.
fn first_bins(pixels: u32) -> (u32, u32) {
    if (MOST_BINS * BIN_PX..=RANKED_PX).contains(&pixels) {
        let capacity = (pixels + pixels / 2) / RANKED_BINS;
        return (RANKED_BINS, capacity.next_multiple_of(BIN_CAPACITY_STEP));
    }
    ((pixels / BIN_PX).next_power_of_two().clamp(LEAST_BINS, MOST_BINS), BIN_CAPACITY)
}

/// Initial places of the cameras, and after them those of their outlets.
pub(super) fn place(configs: &[CameraConfig], options: RigOptions) -> Vec<Place> {
    let mut places: Vec<Place> = configs
        .iter()
        .enumerate()
        .map(|(slot, config)| {
            let sensor = &config.sensor;
            let pixels = sensor.width * sensor.height;
            let blocks_x = sensor.width.div_ceil(BLOCK_PX);
            let events =
                if options.initial_events == 0 { pixels + pixels / 2 } else { options.initial_events };
            let (bin_count, bin_capacity) = first_bins(pixels);
            let place = Place {
                slot: slot as u32,
                pixels,
                height: sensor.height,
                blocks_x,
                blocks: blocks_x * sensor.height.div_ceil(BLOCK_PX),
                tiles: blocks_x.div_ceil(TILE_BLOCKS) * sensor.height.div_ceil(BLOCK_PX),
                bin_count,
                bin_capacity,
                event_capacity: round_events(events),
                has_motion: config.motion.is_some(),
                instances: 1,
                ..Place::default()
            };
            place.with_planes_of(sensor)
        })
        .collect();
    let cameras = places.len();
    places.extend((0..cameras).map(|camera| Place { slot: (cameras + camera) as u32, ..Place::default() }));
    follow_cameras(&mut places);
    lay_out(&mut places);
    places
}

/// Makes the places of outlets, which come after those of as many cameras, as large as their cameras need.
pub(super) fn follow_cameras(places: &mut [Place]) {
    let (cameras, outlets) = places.split_at_mut(places.len() / 2);
    for (outlet, camera) in outlets.iter_mut().zip(cameras) {
        *outlet = outlet.behind(camera);
    }
}

/// Rounds an event capacity up to a multiple of 64, so that every camera's part of every array begins on a whole word.
fn round_events(events: u32) -> u32 {
    events.max(64).checked_next_multiple_of(64).unwrap_or(u32::MAX)
}

/// Lays the places out one after the other: sets their bases.
pub(super) fn lay_out(places: &mut [Place]) {
    let mut next = [0_u64; BINDINGS.len()];
    for place in places {
        let elements = place.elements();
        let mut take = |slot: usize| {
            let base = next[slot];
            next[slot] += elements[slot].unwrap_or(0);
            // A base that does not fit saturates: `allocate` refuses such a buffer.
            u32::try_from(base).unwrap_or(u32::MAX)
        };
        place.plane_base = take(layout::PLANES);
        place.motion_base = take(layout::MOTION);
        place.state_base = take(layout::STATE);
        place.block_base = take(layout::BLOCKS);
        place.bin_base = take(layout::BINS);
        place.bin_storage_base = take(layout::BIN_STORAGE);
        place.event_base = take(layout::OVERFLOW);
        place.aps_base = take(layout::APS);
        place.tile_base = take(layout::TILE_ORDER);
        place.surface_base = take(layout::SURFACES);
        place.representative_base = take(layout::REPRESENTATIVES);
        place.passing_base = take(layout::PASSING);
        place.instance_base = take(layout::INSTANCES);
        place.pose_base = take(layout::POSES);
        place.path_base = take(layout::PATHS);
        place.track_base = take(layout::TRACKS);
        place.bus_base = take(layout::BUS);
    }
}

/// Elements of a buffer over all cameras.
pub(super) fn total(places: &[Place], slot: usize) -> u64 {
    places.iter().filter_map(|p| p.elements()[slot]).sum::<u64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::{HdrFormat, Synthesis, Taps};

    fn config(synthesis: Synthesis) -> CameraConfig {
        let sensor =
            SensorModel { width: 40, height: 24, synthesis, taps: Taps::Cubic, ..SensorModel::default() };
        CameraConfig { sensor, camera: 0, hdr: HdrFormat::F16x4, motion: None, geometry: None }
    }

    #[test]
    fn planes_grow_with_the_sensor_and_what_is_kept_of_them_shrinks_with_it() {
        let (small, large) = (config(Synthesis::Linear), config(Synthesis::Motion));
        let place = place(std::slice::from_ref(&small), RigOptions::default())[0];
        let grown = place.with_planes_of(&large.sensor);
        assert!(grown.plane_words > 3 * place.plane_words);
        assert_eq!(grown.with_planes_of(&small.sensor), grown, "planes do not shrink");
        let kept = |place: Place, sensor| place.kept_elements(layout::PLANES, sensor);
        assert_eq!(kept(grown, &small.sensor), kept(place, &small.sensor));
        assert_eq!(kept(grown, &large.sensor), 2 * u64::from(grown.plane_words));
    }

    #[test]
    fn every_tile_finds_room_for_its_levels_in_a_few_passes() {
        let gpu = KernelPolicy::gpu();
        let of = |synthesis, width, height, policy| {
            let mut config = config(synthesis);
            config.sensor = SensorModel { width, height, substeps: 32, ..config.sensor };
            let places = place(&[config.clone(), config], RigOptions::default());
            (shared_level_rows(places.iter(), policy), level_passes(places.iter(), policy))
        };
        assert_eq!(of(Synthesis::Motion, 640, 480, gpu), (0, 1), "one surface a pixel");
        assert_eq!(of(Synthesis::Rigid, 640, 480, KernelPolicy::software_driver()), (0, 1));
        // Two cameras of 15 blocks.
        assert_eq!(of(Synthesis::Rigid, 40, 24, gpu), (2 * 15 * 33, 1));
        for (width, height, least) in [(640, 480, gpu.least_level_rows), (640, 480, 0), (40, 24, 0)] {
            let policy = KernelPolicy { least_level_rows: least, ..gpu };
            let (rows, passes) = of(Synthesis::Rigid, width, height, policy);
            let blocks = u64::from(2 * width.div_ceil(8) * height.div_ceil(8));
            assert!((2..=MOST_PASSES).contains(&passes), "{passes} passes of {rows} rows");
            assert!(u64::from(passes) * (rows - TILE_LEVEL_ROWS) >= 33 * blocks);
            assert!(16 * rows <= u64::from(2 * width * height).max(16 * u64::from(least)) || width == 40);
        }
    }

    #[test]
    fn images_above_a_megapixel_have_more_bins_with_less_room_in_each() {
        let sizes = [128 * 128, 640 * 480, 1280 * 720, 1920 * 1080, 3840 * 2160, u32::MAX];
        let expected = [(256, 96), (8192, 96), (16_384, 96), (65_536, 48), (16_384, 96), (16_384, 96)];
        assert_eq!(sizes.map(first_bins), expected);
    }

    #[test]
    fn bins_double_where_all_are_crowded_and_take_no_more_room() {
        let place = Place { bin_count: 1024, bin_capacity: 1696, ..Place::default() };
        let is_crowded = |largest, mean| place.is_crowded(largest, mean * place.bin_count);
        assert!(is_crowded(CROWDED_BIN + 1, 675) && !is_crowded(CROWDED_BIN, 675));
        assert!(is_crowded(1 << 20, CROWDED_MEAN + 1));
        assert!(!is_crowded(1 << 20, CROWDED_MEAN), "one instant");
        let more = place.with_more_bins();
        assert_eq!((more.bin_count, more.bin_capacity), (2048, 848));
        let small = Place { bin_capacity: 16, ..place };
        assert_eq!(small.with_more_bins().bin_capacity, 16, "whole lines");
        let outlet = place.behind(&Place { has_bus: true, ..place.with_more_bins().with_more_bins() });
        assert_eq!(
            (outlet.bin_count, outlet.bin_capacity),
            (4096, 432),
            "an outlet takes no more room either"
        );
    }

    #[test]
    fn capacities_beyond_32_bits_stay_at_what_no_device_allocates() {
        let place = place(&[config(Synthesis::Linear)], RigOptions::default())[0];
        assert_eq!(place.with_events(u32::MAX).event_capacity, u32::MAX);
        assert_eq!(place.with_events(1), place);
        assert!(place.with_events(place.event_capacity + 1).event_capacity > place.event_capacity + 1);
    }
}
