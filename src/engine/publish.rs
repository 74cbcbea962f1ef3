//! Publishing: the outputs of a graph as files in a folder, brought up to date at every run.

use super::EngineError;
use super::execution::{Plan, Shot};
use super::resolve::Resolution;
use crate::graph::{Axis, Graph};
use crate::store::Store;
use lightloom_nodes::data::{Array, Arrays, Bytes, Data, Field, Picture, decode};
use lightloom_nodes::node::Digest;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A published file.
#[derive(Clone, Debug)]
pub struct Published {
    /// Name of the output in the graph.
    pub output: String,
    /// The file.
    pub path: PathBuf,
    /// Mean of each array of numbers, for artifacts that are no pictures.
    pub figures: Vec<(String, f64)>,
}

/// What stands in the folder already: file name, digest of the artifact, size, time of change.
type Known = BTreeMap<String, (Digest, u64, u128)>;

/// Remembers what was published, so that an unchanged file is not written again.
const INDEX: &str = ".lightloom.json";

/// Writes every output of the graph into `folder`: pictures as they are, numbers as JSON. Files that
/// are there already with the same content are left alone.
///
/// # Errors
/// When a file cannot be written or a blob cannot be read.
pub fn publish(
    graph: &Graph,
    plan: &Plan,
    known: &Resolution,
    store: &Store,
    folder: &Path,
) -> Result<Vec<Published>, EngineError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |cause| EngineError::Io { path, cause }
    };
    fs::create_dir_all(folder).map_err(io(folder))?;
    let index = folder.join(INDEX);
    let before: Known =
        fs::read(&index).ok().and_then(|b| serde_json::from_slice(&b).ok()).unwrap_or_default();
    let mut after = Known::new();
    let mut published = Vec::new();
    for (output, node) in &graph.outputs {
        let axis = graph.nodes[*node].axis;
        for (item, held) in known.held[*node].iter().enumerate() {
            let Some(held) = held else { continue };
            let Some(map) = store.open_blob(&held.digest, held.bytes)? else { continue };
            let bytes: Bytes = Arc::new(Owner(map));
            let (content, extension, figures) = match graph.nodes[*node].output {
                Picture::TYPE => picture(bytes, folder)?,
                kind => numbers(bytes, kind, folder)?,
            };
            let name = file_name(output, axis, item, plan.shot, &extension);
            let path = folder.join(&name);
            if !stands(&before, &name, &path, held.digest) {
                write_whole(&path, &content).map_err(io(&path))?;
            }
            let (size, changed) = stamp(&path).map_err(io(&path))?;
            after.insert(name, (held.digest, size, changed));
            published.push(Published { output: output.clone(), path, figures });
        }
    }
    if after != before {
        let text = serde_json::to_vec(&after)
            .map_err(|e| EngineError::Io { path: index.clone(), cause: e.into() })?;
        write_whole(&index, &text).map_err(io(&index))?;
    }
    Ok(published)
}

/// A mapped blob as bytes that artifacts may share.
pub struct Owner(pub Arc<memmap2::Mmap>);

impl AsRef<[u8]> for Owner {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

type Content = (Vec<u8>, String, Vec<(String, f64)>);

fn unreadable(folder: &Path, cause: lightloom_nodes::node::Error) -> EngineError {
    EngineError::Io { path: folder.to_owned(), cause: std::io::Error::other(cause.to_string()) }
}

fn picture(bytes: Bytes, folder: &Path) -> Result<Content, EngineError> {
    let picture: Picture = decode(bytes).map_err(|e| unreadable(folder, e))?;
    let extension: String = picture
        .extension
        .iter()
        .map(|b| char::from(*b))
        .filter(char::is_ascii_alphanumeric)
        .collect();
    Ok((picture.bytes.to_vec(), extension, Vec::new()))
}

/// Arrays of numbers as JSON, with the mean of each.
fn numbers(bytes: Bytes, kind: &'static str, folder: &Path) -> Result<Content, EngineError> {
    let arrays = numbers_of(bytes, kind).map_err(|e| unreadable(folder, e))?;
    let mut object = serde_json::Map::new();
    let mut figures = Vec::new();
    for Numbers { name, values, single } in arrays {
        let mean = mean(&values);
        let value = if single { serde_json::json!(mean) } else { serde_json::json!(values) };
        object.insert(name.clone(), value);
        figures.push((name, mean));
    }
    let text = serde_json::to_string_pretty(&object).unwrap_or_default() + "\n";
    Ok((text.into_bytes(), "json".into(), figures))
}

/// An array of an artifact of numbers.
pub struct Numbers {
    /// The array's name.
    pub name: String,
    /// Its values.
    pub values: Vec<f64>,
    /// Whether it is a number and not a list.
    pub single: bool,
}

/// The arrays of an artifact that holds nothing but numbers.
///
/// # Errors
/// When the bytes are no such artifact.
pub fn numbers_of(
    bytes: Bytes,
    kind: &'static str,
) -> Result<Vec<Numbers>, lightloom_nodes::node::Error> {
    let arrays = Arrays::parse(bytes, kind)?;
    let load = |(name, _, shape): (String, _, Vec<usize>)| {
        let (values, single) = match (shape.len(), Array::<f64>::load(&arrays, &name)) {
            (_, Ok(values)) => (values.to_vec(), shape.is_empty()),
            (0, Err(_)) => (vec![f64::load(&arrays, &name)?], true),
            (_, Err(e)) => return Err(e),
        };
        Ok(Numbers { name, values, single })
    };
    arrays.describe().into_iter().map(load).collect()
}

/// The mean; 0 of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// `name.png`, `name.0007.exr` for frame 7, `name.01.png` for the second chunk of several.
fn file_name(output: &str, axis: Axis, item: usize, shot: Shot, extension: &str) -> String {
    match axis {
        Axis::Single => format!("{output}.{extension}"),
        Axis::Chunks if shot.len(Axis::Chunks) == 1 => format!("{output}.{extension}"),
        Axis::Chunks => format!("{output}.{item:02}.{extension}"),
        Axis::Frames | Axis::Pairs => format!("{output}.{item:04}.{extension}"),
    }
}

fn stands(before: &Known, name: &str, path: &Path, digest: Digest) -> bool {
    let Some((known, size, changed)) = before.get(name) else { return false };
    *known == digest && stamp(path).is_ok_and(|now| now == (*size, *changed))
}

fn stamp(path: &Path) -> std::io::Result<(u64, u128)> {
    let meta = fs::metadata(path)?;
    let changed =
        meta.modified()?.duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_nanos());
    Ok((meta.len(), changed))
}

/// Writes a file whole or not at all: a reader of the folder never sees half a picture.
///
/// # Errors
/// When it cannot be written.
pub fn write_whole(path: &Path, content: &[u8]) -> std::io::Result<()> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let part = PathBuf::from(part);
    let written = fs::write(&part, content).and_then(|()| fs::rename(&part, path));
    if written.is_err() {
        let _ = fs::remove_file(&part);
    }
    written
}
