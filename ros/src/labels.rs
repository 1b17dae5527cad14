//! Encodes what events show: the id of each event, and the table of what has which id.

use crate::cdr::CdrWriter;
use crate::encode::Header;

/// A thing that events show.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Instance {
    /// As events have it.
    pub id: i64,
    /// For example the path of its prim.
    pub name: String,
    /// Kinds and labels, for example `("class", "box")`. A kind may have several.
    pub labels: Vec<(String, String)>,
}

/// `esaac_msgs/EventIds`. Header and sequence are those of the message that has the events.
pub fn event_ids(out: &mut Vec<u8>, header: Header<'_>, sequence: u64, ids: &[i64]) {
    let mut cdr = CdrWriter::new(out);
    header.write(&mut cdr);
    cdr.u64(sequence).reserve(size_of_val(ids) + 16).sequence(ids);
}

/// `esaac_msgs/Instances`.
pub fn instances(out: &mut Vec<u8>, header: Header<'_>, instances: &[Instance]) {
    let mut cdr = CdrWriter::new(out);
    header.write(&mut cdr);
    cdr.u32(instances.len() as u32);
    for instance in instances {
        cdr.i64(instance.id).string(&instance.name);
        cdr.u32(instance.labels.len() as u32);
        for (kind, _) in &instance.labels {
            cdr.string(kind);
        }
        cdr.u32(instance.labels.len() as u32);
        for (_, label) in &instance.labels {
            cdr.string(label);
        }
    }
}
