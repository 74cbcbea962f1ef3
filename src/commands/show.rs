//! `show`: where a node's artifact lies, and what is in it.

use super::explain::which;
use super::output::{say, say_json};
use super::run::default_folder;
use super::session::{Failure, Session};
use super::{Common, GraphArgs, figures};
use crate::engine::{EngineError, Held};
use crate::registry::Registry;
use lightloom_nodes::data::{Array, Arrays, Bytes, Data, Field, Image, decode};
use lightloom_nodes::node::{Ctx, Error, Node};
use lightloom_nodes::{Png, PngIn};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(clap::Args)]
pub struct Show {
    #[command(flatten)]
    graph: GraphArgs,
    /// The node, by its name in the graph.
    node: String,
    /// Which of its items, from 0, where it gives a sequence.
    #[arg(long, default_value_t = 0, value_name = "K")]
    item: usize,
    /// Folder of the thumbnail of an image; `out/` and the graph's name by default.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Show {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let session = Session::open(common, &self.graph, registry)?;
        let folder = self.out.clone().unwrap_or_else(|| default_folder(&session.path));
        let shown = Shown::new(&session, &self.node, self.item, &folder)?;
        if common.json { say_json(&shown.json()) } else { say(shown.text()) }
    }
}

/// What is to be said of one artifact.
struct Shown {
    /// `image  Reconstruct v1, frame 3 of 40`.
    title: String,
    data: &'static str,
    held: Held,
    path: PathBuf,
    arrays: Vec<Shape>,
    thumbnail: Option<Result<PathBuf, String>>,
}

/// One array of an artifact.
struct Shape {
    name: String,
    dtype: String,
    shape: Vec<usize>,
    range: Option<Range>,
}

/// What the numbers of an array range over; those that are not finite are only counted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range {
    min: f64,
    mean: f64,
    max: f64,
    not_finite: usize,
}

impl Shown {
    /// Describes item `item` of the node called `name`; an image's thumbnail is written into `folder`.
    fn new(session: &Session, name: &str, item: usize, folder: &Path) -> Result<Shown, Failure> {
        let (graph, store) = (&session.graph, &session.store);
        let at = session.node(name)?;
        let (_, known) = session.resolve(&[at])?;
        let node = &graph.nodes[at];
        let Some(held) = known.held[at].get(item) else {
            let items = known.held[at].len();
            return Err(Failure::Nothing(format!(
                "`{name}` has no item {item}: it gives {items}, counted from 0"
            )));
        };
        let opened = match held {
            Some(held) => store.open_blob(&held.digest, held.bytes)?.map(|map| (*held, map)),
            None => None,
        };
        let Some((held, map)) = opened else { return Err(absent(session, at, held.is_some())) };
        let bytes: Bytes = map;
        let broken = |e: Error| {
            Failure::Engine(EngineError::Io {
                path: store.blob_path(&held.digest),
                cause: std::io::Error::other(e.to_string()),
            })
        };
        let arrays = Arrays::parse(Arc::clone(&bytes), node.output).map_err(broken)?;
        let place = match (which(node.axis, item), known.held[at].len()) {
            (which, _) if which.is_empty() => String::new(),
            (which, items) => format!(", {which} of {items}"),
        };
        let thumbnail = (node.output == Image::TYPE).then(|| {
            let path = folder.join(format!("{name}.{item}.thumbnail.png"));
            thumbnail(bytes, &path).map(|()| path)
        });
        Ok(Shown {
            title: format!("{}  {} v{}{place}", node.name, node.kind, node.version),
            data: node.output,
            held,
            path: std::path::absolute(store.blob_path(&held.digest))
                .unwrap_or_else(|_| store.blob_path(&held.digest)),
            arrays: arrays
                .describe()
                .into_iter()
                .map(|(name, dtype, shape)| {
                    let range = range(&arrays, &name);
                    Shape { name, dtype: format!("{dtype:?}"), shape, range }
                })
                .collect(),
            thumbnail,
        })
    }

    fn python(&self) -> String {
        format!("import safetensors.numpy; arrays = safetensors.numpy.load_file({:?})", self.path)
    }

    fn text(&self) -> String {
        let (digest, size) = (self.held.digest, figures::bytes(self.held.bytes));
        let mut out = format!(
            "{}\n  {}, {size}, digest {digest}\n  {}\n",
            self.title,
            self.data,
            self.path.display()
        );
        let width = self.arrays.iter().map(|a| a.name.len()).max().unwrap_or(0);
        let shapes = self.arrays.iter().map(|a| format!("{:?}", a.shape).len()).max().unwrap_or(0);
        for Shape { name, dtype, shape, range } in &self.arrays {
            let shape = format!("{shape:?}");
            let range = range.map(|r| r.text()).unwrap_or_default();
            let line = format!("    {name:width$}  {dtype:4}  {shape:shapes$}  {range}");
            let _ = writeln!(out, "{}", line.trim_end());
        }
        let _ = writeln!(
            out,
            "  in Python (a safetensors file, though its name has no extension):\n    {}",
            self.python()
        );
        match &self.thumbnail {
            Some(Ok(path)) => out + &format!("  thumbnail: {}\n", path.display()),
            Some(Err(why)) => out + &format!("  no thumbnail: {why}\n"),
            None => out,
        }
    }

    fn json(&self) -> Value {
        let array = |a: &Shape| {
            let range = a.range.map(|r| {
                json!({
                    "min": r.min, "mean": r.mean, "max": r.max, "not_finite": r.not_finite,
                })
            });
            json!({ "name": a.name, "dtype": a.dtype, "shape": a.shape, "range": range })
        };
        json!({
            "ok": true, "type": self.data, "digest": self.held.digest, "bytes": self.held.bytes, "path": self.path,
            "arrays": self.arrays.iter().map(array).collect::<Vec<_>>(), "python": self.python(),
            "thumbnail": self.thumbnail.as_ref().and_then(|t| t.as_ref().ok()),
        })
    }
}

/// Says how to get what is not there.
fn absent(session: &Session, at: usize, evicted: bool) -> Failure {
    let (graph, path) = (&session.graph, session.path.display());
    let name = &graph.nodes[at].name;
    let why = if evicted { "was evicted from the cache" } else { "is not in the cache" };
    let how = match graph.needed(&session.outputs())[at] {
        true if evicted => "it is made again once a run needs it".to_owned(),
        true => format!("`lightloom run {path}` makes it"),
        false => "no output of the graph needs it, so no run makes it".to_owned(),
    };
    Failure::Nothing(format!("the result of `{name}` {why}: {how}"))
}

fn range(arrays: &Arrays, name: &str) -> Option<Range> {
    if let Ok(values) = Array::<f32>::load(arrays, name) {
        return Range::of(values.iter().map(|v| f64::from(*v)));
    }
    Range::of(Array::<f64>::load(arrays, name).ok()?.iter().copied())
}

impl Range {
    /// None when there is no number at all.
    fn of(values: impl Iterator<Item = f64>) -> Option<Range> {
        let (mut min, mut max, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        let (mut finite, mut not_finite) = (0_usize, 0);
        for value in values {
            if value.is_finite() {
                (min, max, sum) = (min.min(value), max.max(value), sum + value);
                finite += 1;
            } else {
                not_finite += 1;
            }
        }
        match (finite, not_finite) {
            (0, 0) => None,
            (0, _) => Some(Range { min: f64::NAN, mean: f64::NAN, max: f64::NAN, not_finite }),
            _ => Some(Range { min, mean: sum / finite as f64, max, not_finite }),
        }
    }

    fn text(self) -> String {
        let Range { min, mean, max, not_finite } = self;
        let odd = if not_finite > 0 { format!("  {not_finite} not finite") } else { String::new() };
        format!("min {}  mean {}  max {}{odd}", number(min), number(mean), number(max))
    }
}

/// Five digits at most: what is huge or tiny in powers of ten.
fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if (1e-3..1e5).contains(&size) => format!("{value:.4}"),
        _ => format!("{value:.3e}"),
    }
}

/// Writes an image as a small PNG, as the node `Png` does by default.
fn thumbnail(bytes: Bytes, path: &Path) -> Result<(), String> {
    let image: Image = decode(bytes).map_err(|e| e.to_string())?;
    let picture = Png::default().run(PngIn { image: reduced(&image).into() }, &Ctx::default());
    let picture = picture.map_err(|e| e.to_string())?;
    let written = path
        .parent()
        .map_or(Ok(()), fs::create_dir_all)
        .and_then(|()| fs::write(path, &picture.bytes[..]));
    written.map_err(|e| format!("{}: {e}", path.display()))
}

/// The image with means over squares of pixels, small enough to look at; rows and columns that fill no square are cut.
fn reduced(image: &Image) -> Image {
    /// Most pixels along a side.
    const SIDE: usize = 320;
    let (width, height) = image.size();
    let step = width.max(height).div_ceil(SIDE).max(1).min(width.min(height).max(1));
    let (columns, rows) = (width / step, height / step);
    let mean = |x: usize, y: usize| {
        let square =
            (0..step).flat_map(|j| (0..step).map(move |i| (y * step + j) * width + x * step + i));
        square.map(|k| image.radiance[k]).reduce(|a, b| a + b).map(|sum| sum / (step * step) as f32)
    };
    let pixels = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    Image::new(columns, rows, pixels.filter_map(|(x, y)| mean(x, y)).collect())
}

#[cfg(test)]
mod tests {
    use super::super::tests::Bench;
    use super::*;
    use glam::Vec3;

    fn shown(bench: &Bench, node: &str, item: usize) -> Result<Shown, Failure> {
        Shown::new(&bench.session(&[]), node, item, &bench.path("thumbnails"))
    }

    fn nothing(shown: Result<Shown, Failure>) -> String {
        match shown {
            Err(Failure::Nothing(why)) => why,
            _ => String::new(),
        }
    }

    #[test]
    fn an_image_is_told_in_numbers_and_as_a_thumbnail() {
        let bench = Bench::new();
        let why = nothing(shown(&bench, "grey", 0));
        assert!(why.contains("not in the cache: `lightloom run "), "{why}");
        bench.run(&[]);
        let grey = shown(&bench, "grey", 2).ok().unwrap();
        let text = grey.text();
        assert!(text.starts_with("grey  Grey v1, frame 2 of 3\n  Image, "), "{text}");
        assert!(
            text.contains("radiance  F32   [4, 4, 3]  min 0.3500  mean 0.3500  max 0.3500"),
            "{text}"
        );
        let blob = fs::read(&grey.path).unwrap();
        assert_eq!(lightloom_nodes::node::Digest::of(&blob), grey.held.digest);
        assert!(text.contains(&format!("load_file({:?})", grey.path)), "{text}");
        let png = fs::read(bench.path("thumbnails/grey.2.thumbnail.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG"));
        assert_eq!(grey.json()["arrays"][0]["shape"], json!([4, 4, 3]));
    }

    #[test]
    fn other_artifacts_have_no_thumbnail_and_missing_items_are_told() {
        let bench = Bench::new();
        bench.run(&[]);
        let errors = shown(&bench, "compare", 1).ok().unwrap();
        assert!(
            errors.text().starts_with("compare  Compare v2, chunk 1 of 2\n  Comparison, "),
            "{}",
            errors.text()
        );
        assert!(
            errors.thumbnail.is_none() && errors.json()["arrays"][0]["range"]["max"].is_number()
        );
        assert!(nothing(shown(&bench, "grey", 3)).contains("no item 3: it gives 3"));
        assert!(nothing(shown(&bench, "gray", 0)).contains("did you mean `grey`"));
        assert!(nothing(shown(&bench, "still", 0)).contains("no output of the graph needs it"));
        let grey = shown(&bench, "grey", 0).ok().unwrap();
        fs::remove_file(&grey.path).unwrap();
        assert!(nothing(shown(&bench, "grey", 0)).contains("evicted"));
    }

    #[test]
    fn thumbnails_are_means_of_whole_squares() {
        let pixels = (0..641 * 3).map(|k| Vec3::splat((k % 641) as f32)).collect();
        let small = reduced(&Image::new(641, 3, pixels));
        assert_eq!(small.size(), (213, 1));
        assert_eq!(
            (small.radiance[0], small.radiance[212]),
            (Vec3::splat(1.0), Vec3::splat(637.0))
        );
        assert_eq!(reduced(&Image::new(0, 0, Vec::new())).size(), (0, 0));
    }

    #[test]
    fn numbers_that_are_none_are_counted() {
        assert_eq!(
            Range::of([1.0, f64::NAN, 3.0].into_iter()).unwrap().text(),
            "min 1.0000  mean 2.0000  max 3.0000  1 not finite"
        );
        assert!(Range::of(std::iter::empty()).is_none());
        assert_eq!(Range::of([f64::INFINITY].into_iter()).unwrap().not_finite, 1);
        assert_eq!([0.0, 1e-9, 123_456.0].map(number), ["0", "1.000e-9", "1.235e5"]);
    }
}
