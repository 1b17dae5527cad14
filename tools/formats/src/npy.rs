//! Arrays of a NumPy archive: each member of the zip is a file in the NPY format, version 1.0.

use anyhow::{Context, Result, ensure};
use std::io::{Read, Seek, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Bytes of magic, version and dictionary length.
const PREAMBLE_BYTES: usize = 10;

/// Writes one array of `count` elements, or a scalar (shape `()`) where `count` is `None`.
pub(crate) fn write<const N: usize>(
    archive: &mut ZipWriter<impl Write + Seek>,
    compression: CompressionMethod,
    (name, descr): (&str, &str),
    count: Option<usize>,
    elements: impl Iterator<Item = [u8; N]>,
) -> Result<()> {
    let options = SimpleFileOptions::default().compression_method(compression).large_file(true);
    archive.start_file(format!("{name}.npy"), options)?;
    archive.write_all(&header(descr, count))?;
    let mut block = Vec::with_capacity(1 << 16);
    for element in elements {
        block.extend_from_slice(&element);
        if block.len() >= (1 << 16) - N {
            archive.write_all(&block)?;
            block.clear();
        }
    }
    archive.write_all(&block)?;
    Ok(())
}

/// Writes a text as one string scalar of UTF-32 code points.
pub(crate) fn write_text(
    archive: &mut ZipWriter<impl Write + Seek>,
    compression: CompressionMethod,
    name: &str,
    text: &str,
) -> Result<()> {
    let characters = text.chars().count().max(1);
    let code_points = text.chars().map(|c| u32::from(c).to_le_bytes());
    write(archive, compression, (name, &format!("<U{characters}")), None, code_points)
}

/// Whether there is an array of this name.
pub(crate) fn has(archive: &ZipArchive<impl Read + Seek>, name: &str) -> bool {
    archive.index_for_name(&format!("{name}.npy")).is_some()
}

/// Reads an array of the given type. Fails if it has more than `most` elements.
pub(crate) fn read<const N: usize>(
    archive: &mut ZipArchive<impl Read + Seek>,
    (name, descr): (&str, &str),
    most: usize,
) -> Result<Vec<[u8; N]>> {
    let (found, data) = read_member(archive, name, most.saturating_mul(N))?;
    ensure!(found == descr, "array `{name}` is of type `{found}`, expected `{descr}`");
    ensure!(data.len() % N == 0, "array `{name}` has {} bytes, expected a multiple of {N}", data.len());
    Ok(data.chunks_exact(N).map(|chunk| chunk.try_into().expect("chunks have N bytes")).collect())
}

/// Reads a text. Fails if it has more than `most` characters.
pub(crate) fn read_text(
    archive: &mut ZipArchive<impl Read + Seek>,
    name: &str,
    most: usize,
) -> Result<String> {
    let (found, data) = read_member(archive, name, most.saturating_mul(4))?;
    ensure!(found.starts_with("<U"), "array `{name}` is of type `{found}`, expected a text (`<U`)");
    data.chunks_exact(4)
        .map(|code| char::from_u32(u32::from_le_bytes(code.try_into().expect("chunks have 4 bytes"))))
        .take_while(|character| *character != Some('\0'))
        .collect::<Option<String>>()
        .with_context(|| format!("array `{name}` holds a code point that is no character"))
}

/// Type and data of a member, at most `most_bytes` of them.
fn read_member(
    archive: &mut ZipArchive<impl Read + Seek>,
    name: &str,
    most_bytes: usize,
) -> Result<(String, Vec<u8>)> {
    ensure!(has(archive, name), "no array `{name}`");
    let member = archive.by_name(&format!("{name}.npy")).with_context(|| format!("array `{name}`"))?;
    let mut bytes = Vec::new();
    // A header of version 1.0 has less than 2^16 bytes.
    let limit = (most_bytes as u64).saturating_add((1 << 16) + PREAMBLE_BYTES as u64);
    member.take(limit).read_to_end(&mut bytes).with_context(|| format!("array `{name}`"))?;
    ensure!(
        bytes.len() >= PREAMBLE_BYTES && bytes.starts_with(b"\x93NUMPY\x01\x00"),
        "array `{name}` is not in the NPY format, version 1.0"
    );
    let start = PREAMBLE_BYTES + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    ensure!(start <= bytes.len(), "array `{name}` ends within its header");
    let data = bytes.split_off(start);
    ensure!(data.len() <= most_bytes, "array `{name}` has more than {most_bytes} bytes");
    let dictionary = String::from_utf8_lossy(&bytes[PREAMBLE_BYTES..]).into_owned();
    let descr = dictionary.split("'descr': '").nth(1).and_then(|rest| rest.split('\'').next());
    let descr = descr.with_context(|| format!("array `{name}` states no simple type: {dictionary}"))?;
    Ok((descr.to_owned(), data))
}

/// Makes a header. It is padded so that the data starts at a multiple of 64 bytes.
fn header(descr: &str, count: Option<usize>) -> Vec<u8> {
    let shape = count.map_or("()".to_owned(), |n| format!("({n},)"));
    let mut dictionary = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    let unpadded = PREAMBLE_BYTES + dictionary.len() + 1;
    dictionary.push_str(&" ".repeat(unpadded.next_multiple_of(64) - unpadded));
    dictionary.push('\n');
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    let length = u16::try_from(dictionary.len()).expect("a header of one short line");
    header.extend_from_slice(&length.to_le_bytes());
    header.extend_from_slice(dictionary.as_bytes());
    header
}
