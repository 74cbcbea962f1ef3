//! Where bytes come from: files beside the scene, data URIs, the binary chunk; and the checked views
//! into them.

use super::container::{self, Document};
use crate::node::Error;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a URI of a file refers to.
pub(super) enum Uri<'a> {
    /// The text of a `data:` URI after its colon.
    Data(&'a str),
    /// A file.
    File(PathBuf),
}

impl<'a> Uri<'a> {
    /// Relative references start at `folder`; percent signs are decoded.
    pub(super) fn new(text: &'a str, folder: &Path) -> Self {
        match text.strip_prefix("data:") {
            Some(data) => Uri::Data(data),
            None => {
                Uri::File(folder.join(String::from_utf8_lossy(&percent_decoded(text)).as_ref()))
            }
        }
    }

    /// The bytes it refers to.
    pub(super) fn read(&self) -> Result<Vec<u8>, Error> {
        match self {
            Uri::File(path) => container::read_regular(path)
                .map_err(|e| Error::invalid(format!("{}: {e}", path.display()))),
            Uri::Data(text) => match text.split_once(',') {
                Some((kind, data)) if kind.ends_with(";base64") => {
                    base64_decoded(data).ok_or_else(|| Error::invalid("the data URI is not base64"))
                }
                Some((_, data)) => Ok(percent_decoded(data)),
                None => Err(Error::invalid("the data URI has no comma")),
            },
        }
    }
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let mut rest = text.as_bytes();
    let mut out = Vec::with_capacity(rest.len());
    while let [first, tail @ ..] = rest {
        let digit = |i: usize| tail.get(i).and_then(|c| (*c as char).to_digit(16));
        rest = tail;
        match (first, digit(0), digit(1)) {
            (b'%', Some(high), Some(low)) => {
                out.push((high * 16 + low) as u8);
                rest = &tail[2..];
            }
            _ => out.push(*first),
        }
    }
    out
}

fn base64_decoded(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for group in text.chunks(4) {
        let mut bits = 0_u32;
        for c in group {
            let value = match c {
                b'A'..=b'Z' => c - b'A',
                b'a'..=b'z' => c - b'a' + 26,
                b'0'..=b'9' => c - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            bits = bits << 6 | u32::from(value);
        }
        bits <<= 6 * (4 - group.len());
        out.extend_from_slice(&bits.to_be_bytes()[1..group.len()]);
    }
    (text.len() % 4 != 1).then_some(out)
}

/// A range of a buffer, and the distance between its elements if it is given.
pub(super) struct View<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) stride: Option<usize>,
}

/// All buffers of a file.
pub(super) struct Buffers(Vec<Option<Arc<Vec<u8>>>>);

impl Buffers {
    /// Reads every buffer once, whatever number of times the file names it. A buffer without a
    /// URI other than the binary chunk is an error only when it is used.
    pub(super) fn read(
        document: &Document,
        folder: &Path,
        binary: Option<Vec<u8>>,
    ) -> Result<Self, Error> {
        let mut files: BTreeMap<PathBuf, Arc<Vec<u8>>> = BTreeMap::new();
        let mut binary = binary.map(Arc::new);
        let mut buffers = Vec::new();
        for (i, buffer) in document.buffers.iter().enumerate() {
            let named = |e: Error| Error::invalid(format!("buffers[{i}]: {e}"));
            let chunk = if i == 0 { binary.take() } else { None };
            let bytes = match buffer.uri.as_deref().map(|uri| Uri::new(uri, folder)) {
                None => chunk,
                Some(Uri::File(path)) if files.contains_key(&path) => files.get(&path).cloned(),
                Some(uri) => {
                    let bytes = Arc::new(uri.read().map_err(named)?);
                    if let Uri::File(path) = uri {
                        files.insert(path, Arc::clone(&bytes));
                    }
                    Some(bytes)
                }
            };
            if let Some(bytes) = &bytes
                && (bytes.len() as u64) < buffer.byte_length.0
            {
                let whole =
                    format!("{} bytes, but byteLength is {}", bytes.len(), buffer.byte_length.0);
                let uri = buffer
                    .uri
                    .as_deref()
                    .filter(|uri| !uri.starts_with("data:"))
                    .unwrap_or("its data");
                return Err(named(Error::invalid(format!("{uri} has {whole}"))));
            }
            buffers.push(bytes);
        }
        Ok(Buffers(buffers))
    }

    /// The view numbered `index`, within its buffer.
    pub(super) fn view(&self, document: &Document, index: usize) -> Result<View<'_>, Error> {
        let wrong = |what: String| Error::invalid(format!("bufferViews[{index}] {what}"));
        let view = document.views.get(index).ok_or_else(|| wrong("does not exist".into()))?;
        let buffer = view.buffer.value();
        let bytes = match self.0.get(buffer) {
            None => return Err(wrong(format!("is in buffers[{buffer}], which does not exist"))),
            Some(None) => return Err(wrong(format!("is in buffers[{buffer}], which has no data"))),
            Some(Some(bytes)) => bytes,
        };
        let start = view.byte_offset.map_or(0, |o| o.0);
        let end = start.checked_add(view.byte_length.0);
        let range =
            end.and_then(|end| bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        let bytes = range.ok_or_else(|| wrong(format!("is past the end of buffers[{buffer}]")))?;
        Ok(View { bytes, stride: view.byte_stride.map(|s| s.0) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_every_length() {
        for (text, bytes) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmE", "fooba")]
        {
            assert_eq!(base64_decoded(text).unwrap(), bytes.as_bytes());
        }
        assert_eq!(base64_decoded("+/-_").unwrap(), [0xfb, 0xff, 0xbf]);
        assert!(base64_decoded("Zg=a").is_none() && base64_decoded("Zm9vY").is_none());
    }

    #[test]
    fn percent_signs_are_decoded_and_broken_ones_kept() {
        assert_eq!(percent_decoded("a%20b%2Fc%zz%4"), b"a b/c%zz%4");
        let uri = Uri::new("a%20b.bin", Path::new("dir"));
        assert!(matches!(uri, Uri::File(path) if path == Path::new("dir/a b.bin")));
    }

    #[test]
    fn data_uris() {
        let read = |text| Uri::new(text, Path::new("")).read();
        assert_eq!(read("data:application/octet-stream;base64,Zm9v").unwrap(), b"foo");
        assert_eq!(read("data:,f%6fo").unwrap(), b"foo");
        assert!(read("data:nothing").is_err());
    }
}
