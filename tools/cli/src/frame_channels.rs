//! Which channels of a folder's frames are read: those that are asked for, else the usual ones, else the passes of a
//! view layer of Blender.

use anyhow::{Result, bail};
use esaac_formats::exr_frame::{ChannelNames, DEPTH_CHANNEL, ID_CHANNEL};

/// Blender's index of objects: the name of version 4, and that of version 5.
const INDEX_PASSES: [&str; 2] = ["IndexOB.X", "Object Index.X"];

/// Channels that are asked for. Each is a whole name, or the end of one after a dot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AskedChannels {
    /// Red, green, blue.
    pub colour: Option<[String; 3]>,
    /// Motion x and y.
    pub motion: Option<[String; 2]>,
    /// Depth.
    pub depth: Option<String>,
    /// Instance ids.
    pub ids: Option<String>,
}

/// The channels of a file, from which is chosen. A channel that is not there keeps the name that was sought.
#[derive(Clone, Debug)]
pub struct FrameChannels<'a> {
    there: &'a [String],
    asked: &'a AskedChannels,
    /// Colour and motion.
    pub names: ChannelNames,
    /// The view layer of Blender that colour is taken from.
    layer: Option<String>,
}

impl<'a> FrameChannels<'a> {
    /// The choice among the channels `there`.
    ///
    /// # Errors
    /// If several channels fit.
    pub fn new(there: &'a [String], asked: &'a AskedChannels) -> Result<Self> {
        let mut names = ChannelNames::default();
        if let Some(colour) = &asked.colour {
            names.colour = whole_names(colour, there)?;
        } else if !names.colour.iter().any(|name| there.contains(name)) {
            let combined = ["R", "G", "B"].map(|component| format!("Combined.{component}"));
            let found = whole_names(&combined, there)?;
            if there.contains(&found[0]) {
                names.colour = found;
            }
        }
        let layer = names.colour[0].strip_suffix(".Combined.R").map(str::to_owned);
        let mut channels = FrameChannels { there, asked, names, layer };
        if let Some(motion) = &asked.motion {
            channels.names.motion = whole_names(motion, there)?;
        } else if !channels.names.motion.iter().any(|name| there.contains(name)) && channels.layer.is_some() {
            channels.names.motion = [channels.pass("Vector.X")?, channels.pass("Vector.Y")?];
        }
        Ok(channels)
    }

    /// Depth.
    ///
    /// # Errors
    /// If several channels fit.
    pub fn depth(&self) -> Result<String> {
        self.geometry(self.asked.depth.as_deref(), DEPTH_CHANNEL, &["Depth.Z"])
    }

    /// Instance ids.
    ///
    /// # Errors
    /// If several channels fit.
    pub fn ids(&self) -> Result<String> {
        self.geometry(self.asked.ids.as_deref(), ID_CHANNEL, &INDEX_PASSES)
    }

    /// Whether motion is Blender's vector pass, of a layer that has colour too.
    #[must_use]
    pub fn has_vector_pass(&self) -> bool {
        let layer = self.names.motion[0].strip_suffix(".Vector.X");
        layer.is_some_and(|layer| self.there.contains(&format!("{layer}.Combined.R")))
    }

    /// The channel that is asked for, else the usual one, else the first of these passes that is there.
    fn geometry(&self, asked: Option<&str>, usual: &str, passes: &[&str]) -> Result<String> {
        if let Some(name) = asked {
            return whole_name(name, self.there);
        }
        if self.layer.is_none() || self.there.iter().any(|channel| channel == usual) {
            return Ok(usual.to_owned());
        }
        for pass in passes {
            let name = self.pass(pass)?;
            if self.there.contains(&name) {
                return Ok(name);
            }
        }
        Ok(passes[0].to_owned())
    }

    /// A pass of the layer of the colour. Blender's layer `Composite` has colour alone; the pass is another layer's then.
    fn pass(&self, name: &str) -> Result<String> {
        let own = self.layer.as_ref().map(|layer| format!("{layer}.{name}"));
        match own.filter(|own| self.there.contains(own)) {
            Some(own) => Ok(own),
            None => whole_name(name, self.there),
        }
    }
}

fn whole_names<const N: usize>(names: &[String; N], there: &[String]) -> Result<[String; N]> {
    let mut found = names.clone();
    for name in &mut found {
        *name = whole_name(name, there)?;
    }
    Ok(found)
}

/// The channel of this name, else the only one that ends with it after a dot, else the name as it is.
fn whole_name(name: &str, there: &[String]) -> Result<String> {
    if there.iter().any(|channel| channel == name) {
        return Ok(name.to_owned());
    }
    let ending = format!(".{name}");
    let found: Vec<&str> = there.iter().map(String::as_str).filter(|c| c.ends_with(&ending)).collect();
    match found[..] {
        [] => Ok(name.to_owned()),
        [only] => Ok(only.to_owned()),
        _ => bail!(
            "{} channels end with `{name}`, expected one: {}; name it in full",
            found.len(),
            found.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLENDER_4: [&str; 8] = [
        "ViewLayer.Combined.A",
        "ViewLayer.Combined.B",
        "ViewLayer.Combined.G",
        "ViewLayer.Combined.R",
        "ViewLayer.Depth.Z",
        "ViewLayer.IndexOB.X",
        "ViewLayer.Vector.X",
        "ViewLayer.Vector.Y",
    ];
    const COMPOSITE: [&str; 3] = ["Composite.Combined.R", "Composite.Combined.G", "Composite.Combined.B"];

    fn owned<const N: usize>(names: [&str; N]) -> [String; N] {
        names.map(str::to_owned)
    }

    /// Colour's red, motion's x, depth, ids, and whether motion is the vector pass.
    fn chosen(there: &[&str], asked: &AskedChannels) -> Result<(String, String, String, String, bool)> {
        let there: Vec<String> = there.iter().map(|&name| name.to_owned()).collect();
        let channels = FrameChannels::new(&there, asked)?;
        let ChannelNames { colour: [red, ..], motion: [x, _] } = channels.names.clone();
        Ok((red, x, channels.depth()?, channels.ids()?, channels.has_vector_pass()))
    }

    fn words(
        red: &str,
        x: &str,
        depth: &str,
        ids: &str,
        is_vector: bool,
    ) -> (String, String, String, String, bool) {
        (red.to_owned(), x.to_owned(), depth.to_owned(), ids.to_owned(), is_vector)
    }

    fn of_view_layer() -> (String, String, String, String, bool) {
        let [red, x] = ["ViewLayer.Combined.R", "ViewLayer.Vector.X"];
        words(red, x, "ViewLayer.Depth.Z", "ViewLayer.IndexOB.X", true)
    }

    #[test]
    fn the_usual_names_come_before_passes() {
        let nothing = AskedChannels::default();
        let usual = words("R", "motion.X", "depth.Z", "id", false);
        let own = ["B", "G", "R", "depth.Z", "id", "motion.X", "motion.Y"];
        assert_eq!(chosen(&own, &nothing).unwrap(), usual);
        assert_eq!(chosen(&[&own[..], &BLENDER_4].concat(), &nothing).unwrap(), usual);
        // Also where they are missing, so that errors tell them.
        assert_eq!(chosen(&["Y"], &nothing).unwrap(), usual);
    }

    #[test]
    fn passes_of_blender_are_found_by_their_names_of_versions_4_and_5() {
        let nothing = AskedChannels::default();
        assert_eq!(chosen(&BLENDER_4, &nothing).unwrap(), of_view_layer());
        let blender_5 =
            BLENDER_4.map(|name| if name.contains("Index") { "ViewLayer.Object Index.X" } else { name });
        assert_eq!(chosen(&blender_5, &nothing).unwrap().3, "ViewLayer.Object Index.X");
        // Missing passes are told by their names in Blender.
        let missing = words("ViewLayer.Combined.R", "Vector.X", "Depth.Z", "IndexOB.X", false);
        assert_eq!(chosen(&BLENDER_4[..4], &nothing).unwrap(), missing);
    }

    #[test]
    fn a_name_that_is_asked_for_is_a_whole_one_or_the_only_end() {
        let asked = AskedChannels {
            motion: Some(owned(["Vector.X", "Vector.Y"])),
            depth: Some("Z".to_owned()),
            ..AskedChannels::default()
        };
        assert_eq!(chosen(&BLENDER_4, &asked).unwrap(), of_view_layer());
        let whole = [&BLENDER_4[..], &["Z"]].concat();
        assert_eq!(chosen(&whole, &asked).unwrap().2, "Z");
        let part = AskedChannels { depth: Some("epth.Z".to_owned()), ..asked };
        assert_eq!(chosen(&BLENDER_4, &part).unwrap().2, "epth.Z", "no layer ends there");
    }

    #[test]
    fn of_several_layers_one_must_be_named() {
        let there = [&BLENDER_4[..], &COMPOSITE].concat();
        let error = chosen(&there, &AskedChannels::default()).unwrap_err().to_string();
        assert!(error.contains("ViewLayer.Combined.R, Composite.Combined.R"), "{error}");
        let asked = AskedChannels { colour: Some(owned(COMPOSITE)), ..AskedChannels::default() };
        let (_, x, depth, ids, is_vector) = of_view_layer();
        assert_eq!(chosen(&there, &asked).unwrap(), (COMPOSITE[0].to_owned(), x, depth, ids, is_vector));
    }
}
