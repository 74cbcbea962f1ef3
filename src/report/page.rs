//! The page: one HTML file with everything inside.

use super::pictures::{self, Fitted};
use super::{Document, NodeCost, Point};
use serde::Serialize;
use std::collections::BTreeMap;

/// No page has as many bytes as this.
pub const LIMIT: usize = 5_000_000;

/// Room for what is said about pictures.
const NOTES: usize = 4_000;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The settings, points and figures alone are beyond [`LIMIT`].
    #[error("{0} bytes without any picture or graph, more than fit in a page: report fewer points")]
    TooLarge(usize),
    /// The document cannot be written as JSON.
    #[error("cannot write the data of the page: {0}")]
    Json(#[from] serde_json::Error),
}

/// What the page reads: the document, with what many points share stored once.
#[derive(Serialize)]
struct Data<'a> {
    #[serde(flatten)]
    document: Head<'a>,
    points: Vec<Entry<'a>>,
    /// Different costs of nodes, that points refer to by place.
    nodes: Vec<&'a NodeCost>,
    /// Different lines of graphs, that points refer to by place.
    lines: Vec<&'a str>,
    pictures: Vec<pictures::Shown>,
    notes: Vec<String>,
}

/// A document without its points.
#[derive(Serialize)]
struct Head<'a> {
    title: &'a str,
    source: &'a str,
    made: u64,
    version: &'a str,
    axes: &'a [super::Axis],
    seed: &'a Option<super::Axis>,
    figures: &'a [String],
    plot: &'a super::Plot,
    settings: &'a [super::Setting],
    cheapest: &'a [super::Cheapest],
}

/// A point with places instead of what it shares.
#[derive(Serialize)]
struct Entry<'a> {
    setting: usize,
    seed: &'a Option<String>,
    fate: super::Fate,
    problem: &'a Option<String>,
    figures: &'a BTreeMap<String, f64>,
    evaluations: Option<u64>,
    cpu_seconds: Option<f64>,
    together: bool,
    other_host: bool,
    nodes: Vec<usize>,
    pictures: Vec<(&'a str, usize)>,
    graph: Vec<usize>,
}

/// The page of `document`: HTML without any network access, below [`LIMIT`] bytes.
///
/// Pictures are made smaller until the page fits. If even the text is too large, the graphs are left
/// out, then the costs of nodes, and the page says so.
///
/// # Errors
/// When what is left is still too large.
pub fn page(document: &Document) -> Result<String, ReportError> {
    within(document, LIMIT)
}

fn within(document: &Document, limit: usize) -> Result<String, ReportError> {
    let wanted = wanted(document);
    let mut size = 0;
    for (graphs, costs) in [(true, true), (false, true), (false, false)] {
        let mut data = collect(document, graphs, costs)?;
        // The new places of pictures may have more digits.
        let digits: usize = document.points.iter().map(|point| 6 * point.pictures.len()).sum();
        size = html(document, &data)?.len() + NOTES + digits;
        if size >= limit {
            continue;
        }
        let fitted = pictures::fit(&document.pictures, &wanted, limit - size - 1);
        for (entry, point) in data.points.iter_mut().zip(&document.points) {
            entry.pictures = named(point, &fitted);
        }
        data.pictures = fitted.pictures;
        data.notes.extend(fitted.notes);
        let text = html(document, &data)?;
        if text.len() < limit {
            return Ok(text);
        }
        size = text.len();
    }
    Err(ReportError::TooLarge(size))
}

fn named<'a>(point: &'a Point, fitted: &Fitted) -> Vec<(&'a str, usize)> {
    let shown =
        |(name, place): &'a (String, usize)| Some((name.as_str(), *fitted.places.get(place)?));
    point.pictures.iter().filter_map(shown).collect()
}

/// The pictures that points show, those that matter most first: the first picture of each setting,
/// then its others, then those of further seeds.
fn wanted(document: &Document) -> Vec<usize> {
    let mut seeds = vec![0_usize; document.settings.len()];
    let mut ranked = Vec::new();
    for (at, point) in document.points.iter().enumerate() {
        let Some(seed) = seeds.get_mut(point.setting) else { continue };
        let pictures = point.pictures.iter().enumerate();
        ranked.extend(pictures.map(|(k, (_, place))| ((*seed, k, at), *place)));
        *seed += usize::from(!point.pictures.is_empty());
    }
    ranked.sort_unstable();
    ranked.into_iter().map(|(_, place)| place).collect()
}

fn collect(document: &Document, graphs: bool, costs: bool) -> Result<Data<'_>, ReportError> {
    let mut lines = Interned::default();
    let mut nodes = Interned::default();
    let mut points = Vec::with_capacity(document.points.len());
    for point in &document.points {
        let kept = if costs { point.nodes.as_slice() } else { &[] };
        let text = if graphs { point.graph.as_str() } else { "" };
        let place = |node| Ok(nodes.place(serde_json::to_string(node)?, node));
        points.push(Entry {
            setting: point.setting,
            seed: &point.seed,
            fate: point.fate,
            problem: &point.problem,
            figures: &point.figures,
            evaluations: point.evaluations,
            cpu_seconds: point.cpu_seconds,
            together: point.together,
            other_host: point.other_host,
            nodes: kept.iter().map(place).collect::<Result<_, ReportError>>()?,
            pictures: point.pictures.iter().map(|(name, at)| (name.as_str(), *at)).collect(),
            graph: text.lines().map(|line| lines.place(line, line)).collect(),
        });
    }
    let left_out = |what: &str| format!("{what} are left out, so that the page stays below 5 MB.");
    let missing = [(graphs, "The graphs of the points"), (costs, "The costs of the nodes")];
    let notes = missing.iter().filter(|(there, _)| !there).map(|(_, what)| left_out(what));
    Ok(Data {
        document: Head {
            title: &document.title,
            source: &document.source,
            made: document.made,
            version: &document.version,
            axes: &document.axes,
            seed: &document.seed,
            figures: &document.figures,
            plot: &document.plot,
            settings: &document.settings,
            cheapest: &document.cheapest,
        },
        points,
        nodes: nodes.list,
        lines: lines.list,
        pictures: Vec::new(),
        notes: notes.collect(),
    })
}

/// Each different value once, in the order in which they came.
struct Interned<K, V> {
    places: BTreeMap<K, usize>,
    list: Vec<V>,
}

impl<K, V> Default for Interned<K, V> {
    fn default() -> Self {
        Interned { places: BTreeMap::new(), list: Vec::new() }
    }
}

impl<K: Ord, V> Interned<K, V> {
    fn place(&mut self, key: K, value: V) -> usize {
        let next = self.list.len();
        let place = *self.places.entry(key).or_insert(next);
        if place == next {
            self.list.push(value);
        }
        place
    }
}

fn html(document: &Document, data: &Data) -> Result<String, ReportError> {
    // `<` is the only character that could end the element, or open a comment in it.
    let json = serde_json::to_string(data)?.replace('<', "\\u003c");
    let title = document.title.replace('&', "&amp;").replace('<', "&lt;");
    let mut text = String::new();
    // One pass: what is put in is not searched for further marks.
    for (k, part) in include_str!("page.html").split("{{").enumerate() {
        let (mark, rest) =
            if k == 0 { ("", part) } else { part.split_once("}}").unwrap_or(("", part)) };
        text += match mark {
            "title" => &title,
            "style" => include_str!("page.css"),
            "data" => &json,
            "script" => include_str!("page.js"),
            _ => "",
        };
        text += rest;
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::super::{Encoded, Setting};
    use super::*;
    use serde_json::Value;

    fn document(points: usize) -> Document {
        let node = |name: String| NodeCost { name, counts: true, ..NodeCost::default() };
        let point = |k: usize| Point {
            setting: k,
            nodes: vec![node("shared".to_owned()), node(format!("own {k}"))],
            graph: format!("Graph(\n    // </script><!-- {{{{script}}}}\n    k: {k},\n)\n"),
            ..Point::default()
        };
        Document {
            title: "</title><script>alert(1)</script> & {{data}}".to_owned(),
            settings: (0..points)
                .map(|k| Setting { points: vec![k], ..Setting::default() })
                .collect(),
            points: (0..points).map(point).collect(),
            ..Document::default()
        }
    }

    /// What the script of a page reads.
    fn data(page: &str) -> Value {
        let (_, rest) = page.split_once(r#"<script type="application/json" id="data">"#).unwrap();
        serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
    }

    #[test]
    fn text_stays_text() {
        let text = page(&document(2)).unwrap();
        assert_eq!(text.matches("</script>").count(), 2);
        assert_eq!(text.matches("<!--").count(), 0);
        assert!(text.contains("<title>&lt;/title>&lt;script>alert(1)&lt;/script> &amp; {{data}}"));
        assert!(text.contains("default-src 'none'; img-src data:"));
        assert_eq!(data(&text)["title"], "</title><script>alert(1)</script> & {{data}}");
    }

    #[test]
    fn what_points_share_is_stored_once() {
        let document = document(30);
        let data = data(&page(&document).unwrap());
        assert_eq!(data["lines"].as_array().unwrap().len(), 3 + 30);
        assert_eq!(data["nodes"].as_array().unwrap().len(), 1 + 30);
        for (point, original) in data["points"].as_array().unwrap().iter().zip(&document.points) {
            let line = |at: &Value| data["lines"][at.as_u64().unwrap() as usize].as_str().unwrap();
            let lines: Vec<&str> = point["graph"].as_array().unwrap().iter().map(line).collect();
            assert_eq!(lines.join("\n") + "\n", original.graph);
            let own = point["nodes"][1].as_u64().unwrap() as usize;
            assert_eq!(data["nodes"][own]["name"], original.nodes[1].name);
        }
    }

    #[test]
    fn the_limit_holds_and_what_gives_way_is_told() {
        let mut document = document(60);
        document.pictures = vec![Encoded { bytes: vec![7; 90], extension: "png".to_owned() }];
        document.points[0].pictures = vec![("picture".to_owned(), 0), ("lost".to_owned(), 9)];
        let whole = page(&document).unwrap().len();
        let notes = |page: &str| data(page)["notes"].to_string();
        let mut told = Vec::new();
        for limit in (0..whole + 2 * NOTES).step_by(400) {
            match within(&document, limit) {
                Ok(page) => {
                    assert!(page.len() < limit, "{} of {limit}", page.len());
                    told.push((notes(&page).contains("graphs"), notes(&page).contains("costs")));
                }
                Err(ReportError::TooLarge(size)) => assert!(size >= limit && told.is_empty()),
                Err(e) => panic!("{e}"),
            }
        }
        told.dedup();
        assert_eq!(told, [(true, true), (true, false), (false, false)]);
    }

    #[test]
    fn the_pictures_of_settings_come_before_those_of_seeds() {
        let mut document = document(3);
        document.points[2].setting = 0;
        for (at, point) in document.points.iter_mut().enumerate() {
            let name = |k: usize| (format!("p{k}"), 10 * at + k);
            point.pictures = vec![name(0), name(1)];
        }
        assert_eq!(wanted(&document), [0, 10, 1, 11, 20, 21]);
        document.points[1].setting = 99;
        assert_eq!(wanted(&document), [0, 1, 20, 21]);
    }
}
