//! Saved states that somebody has made up.

/// The CRC-32 of bytes, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &byte| {
        (0..8)
            .fold(crc ^ u32::from(byte), |crc: u32, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}

/// A saved state with another header, which is JSON, and a checksum that fits.
#[must_use]
pub fn with_header(saved: &[u8], change: impl FnOnce(&str) -> String) -> Vec<u8> {
    let header_bytes = u64::from_le_bytes(saved[8..16].try_into().expect("eight bytes")) as usize;
    let (header, body) = saved[16..saved.len() - 4].split_at(header_bytes);
    let header = change(std::str::from_utf8(header).expect("JSON"));
    let mut bytes = saved[..8].to_vec();
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(body);
    bytes.extend(crc32(&bytes).to_le_bytes());
    bytes
}

/// A saved state in which the value of a header's key is another one, in the first camera that has the key.
///
/// # Panics
/// If there is no such key.
#[must_use]
pub fn with_value(saved: &[u8], key: &str, value: &str) -> Vec<u8> {
    with_header(saved, |header| {
        let key = format!("\"{key}\":");
        let (before, after) = header.split_once(&key).expect("a header with this key");
        let end = if after.starts_with('[') { after.find(']').map(|end| end + 1) } else { after.find(',') };
        format!("{before}{key}{value}{}", &after[end.expect("more follows")..])
    })
}
