//! Graph files, good and bad, with nodes made for the purpose.

use super::*;
use lightloom_nodes::data::Array;
use lightloom_nodes::node::{All, Ctx, Error, File, Item, Many, Node, Problems, Sequence, Window};

lightloom_nodes::artifact! {
    /// Time of a frame.
    pub struct ToyTime { /// Seconds.
        seconds: f64 }
}
lightloom_nodes::artifact! {
    /// A shape.
    pub struct ToyShape { /// Points.
        points: Array<f32> }
}
lightloom_nodes::artifact! {
    /// Lights.
    pub struct ToyLights { /// Powers.
        power: Array<f32> }
}
lightloom_nodes::artifact! {
    /// Something published.
    pub struct Picture { /// Bytes.
        bytes: Array<u8> }
}
lightloom_nodes::choice! {
    /// How to pick.
    pub enum ToyPick { /// Largest.
        Max = "max", /// Any.
        Random = "random" }
}

/// A node that is never run: kind, parameters, ports, output.
macro_rules! toy {
    ($kind:ident { $($params:tt)* } $in:ident { $($ports:tt)* } -> $out:ty $(, check($self:ident, $problems:ident) $check:block)?) => {
        lightloom_nodes::params! { /// A toy.
            pub struct $kind { $($params)* } }
        lightloom_nodes::inputs! { /// Its inputs.
            pub struct $in { $($ports)* } }
        impl Node for $kind {
            const KIND: &'static str = stringify!($kind);
            const VERSION: u32 = 1;
            type In = $in;
            type Out = $out;
            $(fn check(&$self, $problems: &mut Problems) $check)?
            fn run(&self, _: $in, _: &Ctx) -> Result<$out, Error> {
                Err(Error::invalid("toys do not run"))
            }
        }
    };
}

toy! { ToyFrames { /// First frame.
    first: u32 = 0; /// Last frame, included.
    last: u32 = 39; /// Frames a second.
    fps: f64 = 24.0, 0.001..=1000.0; } ToyFramesIn {} -> Sequence<ToyTime>,
    check(self, problems) {
        if self.last < self.first {
            problems.report("last", format!("frame {} is before the first, {}", self.last, self.first));
        }
    }
}
toy! { ToyModel { /// A glTF file.
file: File; } ToyModelIn {} -> ToyShape }
toy! { ToyPose {} ToyPoseIn { /// What to pose.
shape: Item<ToyShape>, /// When.
time: Option<Item<ToyTime>> } -> ToyShape }
toy! { ToyLamp { /// Power in watts.
power: f32 = 1.0, 0.0..=1e6; /// Which are kept.
pick: ToyPick = ToyPick::Max; } ToyLampIn {} -> ToyLights }
toy! { ToyMerge {} ToyMergeIn { /// What to join.
lights: Many<ToyLights> } -> ToyLights }
toy! { ToyMotion {} ToyMotionIn { /// Neighbouring frames.
shapes: Window<ToyShape> } -> ToyShape }
toy! { ToyFit { /// How many.
count: u32 = 8, 1..=64; } ToyFitIn { /// All frames.
shapes: All<ToyShape>, /// The lights.
lights: Option<Item<ToyLights>> } -> ToyLights }
toy! { ToyWeave {} ToyWeaveIn { /// All frames.
shapes: All<ToyShape>, /// Maps between them.
maps: Option<All<ToyShape>>, /// What was fitted.
fit: Option<Item<ToyLights>> } -> Sequence<ToyShape> }
toy! { ToyGlow {} ToyGlowIn { /// What glows.
shape: Item<ToyShape> } -> ToyLights }
toy! { ToyReduce {} ToyReduceIn { /// All frames.
shapes: All<ToyShape> } -> ToyShape }
toy! { ToyPrint { /// Size in pixels.
size: [u32; 2] = [640, 360]; } ToyPrintIn { /// What to show.
shape: Item<ToyShape>, /// Lit by.
lights: Option<Item<ToyLights>> } -> Picture }

fn registry() -> Registry {
    let registry = Registry::builtin()
        .with::<ToyFrames>()
        .with::<ToyModel>()
        .with::<ToyPose>()
        .with::<ToyLamp>();
    registry
        .with::<ToyMerge>()
        .with::<ToyMotion>()
        .with::<ToyFit>()
        .with::<ToyWeave>()
        .with::<ToyPrint>()
        .with::<ToyGlow>()
        .with::<ToyReduce>()
}

const GOOD: &str = r#"#![enable(implicit_some)]
// A shot.
Graph(
    vars: {
        "size": (64, 36),   // pixels
        "file": "../scenes/x.glb",
    },
    nodes: {
        "print": ToyPrint(shape: "woven", lights: "lights", size: "$size"),
        "frames": ToyFrames(first: 2, last: 9 /* included */, fps: 20),
        "model": ToyModel(file: "$file"),
        "pose": ToyPose(shape: "model", time: "frames"),
        "sky": ToyLamp(power: 1e3, pick: max),
        "lamp": ToyLamp,
        "lights": ToyMerge(lights: ["sky", "lamp"]),
        "motion": ToyMotion(shapes: "pose"),
        "fit": ToyFit(shapes: "pose", lights: "lights"),
        "woven": ToyWeave(shapes: "pose", maps: "motion", fit: "fit"),
        "still": ToyPrint(shape: "model"),
    },
    outputs: { "frame": "print", "still": "still" },
)
"#;

fn load(text: &str, sets: &[&str]) -> Result<Graph, Vec<Diagnostic>> {
    let sets: Vec<Override> = sets.iter().map(|s| Override((*s).to_owned())).collect();
    Graph::read(text, "shot.ron", Path::new("shots"), &registry(), &sets)
}

fn told(result: Result<Graph, Vec<Diagnostic>>) -> String {
    let mistakes = result.map_or_else(|m| m, |g| g.warnings);
    mistakes.iter().map(|m| m.render(false)).collect::<Vec<_>>().join("\n\n")
}

fn good(sets: &[&str]) -> Graph {
    load(GOOD, sets).unwrap_or_else(|m| panic!("{}", told(Err(m))))
}

#[test]
fn reads_a_graph() {
    let graph = good(&[]);
    let names: Vec<&str> = graph.nodes.iter().map(|n| &*n.name).collect();
    assert_eq!(
        names,
        [
            "frames", "model", "pose", "sky", "lamp", "lights", "motion", "fit", "woven", "print",
            "still"
        ]
    );
    let axis = |name: &str| graph.find(name).map(|n| (graph.nodes[n].runs, graph.nodes[n].axis));
    assert_eq!(axis("frames"), Some((Axis::Single, Axis::Frames)));
    assert_eq!(axis("pose"), Some((Axis::Frames, Axis::Frames)));
    assert_eq!(axis("lights"), Some((Axis::Single, Axis::Single)));
    assert_eq!(axis("motion"), Some((Axis::Pairs, Axis::Pairs)));
    assert_eq!(axis("fit"), Some((Axis::Chunks, Axis::Chunks)));
    assert_eq!(axis("woven"), Some((Axis::Chunks, Axis::Frames)));
    assert_eq!(axis("print"), Some((Axis::Frames, Axis::Frames)));
    assert_eq!(graph.nodes[8].inputs, [("shapes", vec![2]), ("maps", vec![6]), ("fit", vec![7])]);
    assert_eq!(graph.outputs, [("frame".to_owned(), 9), ("still".to_owned(), 10)]);
    assert_eq!(graph.nodes[1].node.reads(), [Path::new("shots/../scenes/x.glb")]);
    assert_eq!(
        graph.nodes[3].node.canonical(),
        [("power", "1000.0".to_owned()), ("pick", "max".to_owned())]
    );
    assert!(graph.warnings.is_empty());
    let given = &graph.nodes[9].given[0];
    assert_eq!(
        (&*given.name, &*given.text, &*given.span.place()),
        ("size", "(64, 36)", "shot.ron:5:17")
    );
    assert_eq!(graph.vars[1].text, "\"../scenes/x.glb\"");
}

#[test]
fn only_what_is_asked_for_is_needed() {
    let graph = good(&[]);
    let needed = graph.needed(&[graph.find("still").unwrap()]);
    let names: Vec<&str> =
        graph.nodes.iter().zip(&needed).filter(|(_, n)| **n).map(|(n, _)| &*n.name).collect();
    assert_eq!(names, ["model", "still"]);
    assert!(graph.needed(&[99]).iter().all(|n| !n));
}

#[test]
fn overrides_replace_values() {
    let graph = good(&[
        "size=(1, 1)",
        "size=(8, 4)",
        "file=y.glb",
        "sky.pick=random",
        "lamp.power=3",
        "frames.last=5",
        "print.lights=None",
        "fit.lights=sky",
    ]);
    assert!(good(&["print.size=(8, 4)"]).warnings.is_empty());
    let canonical = |name: &str| graph.nodes[graph.find(name).unwrap()].node.canonical();
    assert_eq!(canonical("print")[0].1, "(8, 4)");
    assert_eq!(canonical("sky")[1].1, "random");
    assert_eq!(canonical("lamp")[0].1, "3.0");
    assert_eq!(canonical("frames")[1].1, "5");
    let print = &graph.nodes[graph.find("print").unwrap()];
    assert_eq!(print.inputs.len(), 1);
    assert_eq!(print.given[0].span.place(), "<--set>:1:6");
    assert_eq!(graph.nodes[graph.find("model").unwrap()].node.reads(), [Path::new("shots/y.glb")]);
    assert_eq!(graph.nodes[graph.find("fit").unwrap()].inputs[1].1, [graph.find("sky").unwrap()]);
}

#[test]
fn bad_overrides_are_shown_with_their_text() {
    insta::assert_snapshot!(told(load(
        GOOD,
        &[
            "sized=(1, 1)",
            "pint.size=(1, 1)",
            "print.sise=(1, 1)",
            "fit.count=65",
            "size=(1, 2, 3)",
            "file=(",
            "count"
        ],
    )));
}

#[test]
fn drawings() {
    let graph = good(&[]);
    insta::assert_snapshot!("dot", dot(&graph));
    insta::assert_snapshot!("mermaid", mermaid(&graph));
}

#[test]
fn no_beginning_of_a_file_and_no_missing_character_is_a_surprise() {
    for (i, c) in GOOD.char_indices() {
        let (start, rest) = (&GOOD[..i], &GOOD[i + c.len_utf8()..]);
        told(load(start, &[]));
        told(load(rest, &[]));
        told(load(&format!("{start}{rest}"), &[]));
    }
}

#[test]
fn large_graphs_are_quick() {
    let mut text = String::from("Graph(nodes: {\n\"n0\": ToyModel(file: \"x.glb\"),\n");
    for k in 1..10_000 {
        text += &format!("\"n{k}\": ToyPose(shape: \"n{}\"),\n", k - 1);
    }
    text += "\"show\": ToyPrint(shape: \"n9999\") }, outputs: { \"a\": \"show\" })";
    let start = std::time::Instant::now();
    let graph = load(&text, &[]).unwrap_or_else(|m| panic!("{}", told(Err(m))));
    assert_eq!(graph.nodes.len(), 10_001);
    let bad = text.replace("\"x.glb\"", "7").replace("shape", "shap");
    assert_eq!(load(&bad, &[]).map(|_| ()).unwrap_err().len(), 20_001);
    let ring = text.replace("ToyModel(file: \"x.glb\")", "ToyPose(shape: \"n9999\")");
    assert_eq!(load(&ring, &[]).map(|_| ()).unwrap_err().len(), 1);
    assert!(start.elapsed().as_secs() < 10, "{:?}", start.elapsed());
}

/// A bad file and what is said about it, kept beside this file.
macro_rules! bad {
    ($($name:ident: $text:expr;)*) => { $(
        #[test]
        fn $name() {
            let text: &str = $text;
            let result = load(text, &[]);
            insta::assert_snapshot!(format!("bad_{}", stringify!($name)), told(result));
        }
    )* };
}

/// A graph of these nodes, with a sound output.
macro_rules! graph {
    ($nodes:expr) => {
        concat!("Graph(\n  nodes: {\n    \"model\": ToyModel(file: \"x.glb\"),\n    \"show\": ToyPrint(shape: \"model\"),\n", $nodes, "\n  },\n  outputs: { \"still\": \"show\" },\n)\n")
    };
}

bad! {
    missing_comma: "Graph(\n  nodes: {\n    \"model\": ToyModel(file: \"x.glb\")   // no comma\n    \"show\": ToyPrint(shape: \"model\" size: (1, 2)),\n  }\n  outputs: { \"a\": \"show\" },\n)\n";
    not_closed: "Graph(\n  nodes: {\n    \"model\": ToyModel(file: \"x.glb\",\n    \"show\": ToyPrint(shape: \"model\", size: (1, 2),\n  outputs: { \"a\": \"show\" },\n)\n";
    ends_early: "Graph(\n  nodes: {\n    \"model\": ToyModel(file: \"x.glb\"),\n";
    wrong_bracket: "Graph(\n  nodes: {\n    \"model\": ToyModel(file: [\"x.glb\"}),\n  },\n)\n";
    string_not_closed: "Graph(\n  nodes: {\n    \"model: ToyModel(file: \"x.glb\"),\n    \"show\": ToyPrint(shape: \"model),\n  },\n)\n";
    slips: graph!("    \"a\": ToyLamp(power = 2, pick 'max'),\n    \"b\": ToyFit(count: , shapes: model),\n    c: ToyLamp(\"power\": 12x,, 7),\n    \"d\": ToyPrint(shape: \"model\", size: $size),");
    no_graph: "nodes: {}";
    empty: "";
    unknown_fields: "Graph(\n  node: {},\n  colour: 3,\n  nodes: {},\n  vars: [1],\n)\n";
    unknown_kind: graph!("    \"a\": ToyLmp(power: 2),\n    \"b\": 7,\n    \"c\": ToyLamp(2.0),");
    unknown_field: graph!("    \"a\": ToyLamp(pwer: 2),\n    \"b\": ToyPose(shape: \"model\", tiem: \"model\", colour: 3),");
    missing: graph!("    \"a\": ToyModel(),\n    \"b\": ToyPose,\n    \"c\": ToyMerge(lights: []),");
    wrong_values: graph!("    \"a\": ToyLamp(power: \"two\", pick: best),\n    \"b\": ToyLamp(power: -1),\n    \"c\": ToyModel(file: 7),\n    \"d\": ToyFrames(first: 1.5, last: -1),\n    \"e\": ToyPrint(shape: \"model\", size: (1, 2, 3)),");
    not_finite: graph!("    \"a\": ToyLamp(power: NaN),\n    \"b\": ToyLamp(power: 1e39),\n    \"c\": ToyFrames(fps: inf),\n    \"d\": ToyLamp(power: 1e-60),");
    does_not_fit: graph!("    \"a\": ToyFrames(first: 5, last: 3),");
    unknown_node: "Graph(\n  nodes: {\n    \"model\": ToyModel(file: \"x.glb\"),\n    \"show\": ToyPrint(shape: \"modle\", lights: \"sun\"),\n  },\n  outputs: { \"a\": \"shwo\", \"b\": 3, \"c\": show },\n)\n";
    wrong_type: graph!("    \"lamp\": ToyLamp(),\n    \"a\": ToyPose(shape: \"lamp\"),\n    \"b\": ToyMerge(lights: [\"lamp\", \"model\"]),\n    \"c\": ToyPose(shape: \"model\", time: \"lamp\"),");
    wrong_shape: graph!("    \"a\": ToyPose(shape: [\"model\"]),\n    \"b\": ToyPose(shape: model),\n    \"c\": ToyPose(shape: ToyModel(file: \"y.glb\")),\n    \"d\": ToyPose(shape: None),");
    cycles: graph!("    \"a\": ToyPose(shape: \"c\"),\n    \"b\": ToyPose(shape: \"a\"),\n    \"c\": ToyPose(shape: \"b\"),\n    \"d\": ToyPose(shape: \"c\"),\n    \"e\": ToyPose(shape: \"e\"),");
    duplicates: "Graph(\n  vars: { \"p\": 1, \"p\": 2 },\n  nodes: {\n    \"show\": ToyPrint(shape: \"model\", shape: \"model\"),\n    \"model\": ToyModel(file: \"x.glb\"),\n    \"model\": ToyModel(file: \"y.glb\"),\n    \"lamp\": ToyLamp(power: \"$p\"),\n  },\n  outputs: { \"a\": \"show\", \"a\": \"show\" },\n  outputs: {},\n)\n";
    variables: "Graph(\n  vars: { \"size\": (1, 2), \"power\": \"two\", \"other\": \"$size\", \"spare\": 1 },\n  nodes: {\n    \"model\": ToyModel(file: \"$fil\"),\n    \"show\": ToyPrint(shape: \"model\", size: \"$sise\"),\n    \"a\": ToyLamp(power: \"$power\"),\n    \"b\": ToyPrint(shape: \"model\", size: \"$other\"),\n    \"c\": ToyPrint(shape: \"model\", size: \"$size\"),\n  },\n  outputs: { \"a\": \"show\" },\n)\n";
    unused_variable: "Graph(\n  vars: { \"spare\": 1 },\n  nodes: { \"model\": ToyModel(file: \"x.glb\") },\n)\n";
    not_published: "Graph(\n  nodes: {\n    \"model\": ToyModel(file: \"x.glb\"),\n    \"show\": ToyPrint(shape: \"model\"),\n  },\n  outputs: { \"../a\": \"model\", \"b\": \"show\" },\n)\n";
    bad_names: graph!("    \"a.b\": ToyLamp(),\n    \"\": ToyLamp(),\n    \"$x\": ToyLamp(),");
    axes: graph!(concat!(
        "    \"frames\": ToyFrames(),\n    \"more\": ToyFrames(),\n    \"pose\": ToyPose(shape: \"model\", time: \"frames\"),\n",
        "    \"motion\": ToyMotion(shapes: \"pose\"),\n    \"still\": ToyMotion(shapes: \"model\"),\n",
        "    \"mixed\": ToyPose(shape: \"motion\", time: \"frames\"),\n",
        "    \"lit\": ToyFit(shapes: \"pose\"),\n    \"chunked\": ToyPrint(shape: \"pose\", lights: \"lit\"),\n",
        "    \"woven\": ToyWeave(shapes: \"pose\", fit: \"lit\"),\n    \"cannot\": ToyWeave(shapes: \"model\", fit: \"lit\"),\n",
        "    \"beside\": ToyFit(shapes: \"pose\", lights: \"perframe\"),\n    \"perframe\": ToyGlow(shape: \"pose\"),\n",
        "    \"reduced\": ToyReduce(shapes: \"pose\"),\n    \"whole\": ToyReduce(shapes: \"reduced\"),"
    ));
    ten_at_once: "Graph(\n  vars: { \"size\": (64 36), \"spare\": 1 },\n  nodes: {\n    \"model\": ToyModel(fle: \"x.glb\"),\n    \"lamp\": ToyLmp(power: 2),\n    \"sky\": ToyLamp(power = -3),\n    \"pose\": ToyPose(shape: \"modell\", time: \"sky\"),\n    \"show\": ToyPrint(shape: [\"pose\"], size: \"$sizes\"),\n    \"sky\": ToyLamp(power: NaN),\n  },\n  outputs: { \"frame\": \"sky\" },\n)\n";
}
