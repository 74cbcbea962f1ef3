//! The engine through the library: what runs again after what, what survives, and what is refused.

use crate::workspace::{SMALL, Silent, Workspace, most_at_once, options, runs_of, tag};
use lightloom::engine::{EngineError, Options, Progress};
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// What follows the clustering in the tensor graph.
const AFTER_CLUSTERING: &[&str] =
    &["representatives", "image", "smooth", "exr", "still", "png", "preview"];

/// Five frames in chunks of two; the times are 0, 1, 2, 3, 4.
fn toys(nodes: &str) -> Workspace {
    let frames = "\"frames\": Frames(last: 4, fps: 1, chunk: 2),";
    Workspace::new(&format!("#![enable(implicit_some)]\nGraph(nodes: {{ {frames} {nodes} }})"))
}

/// Changes one byte of a file, in the middle of it.
fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let at = bytes.len() / 2;
    bytes[at] ^= 0x10;
    fs::set_permissions(path, Permissions::from_mode(0o644)).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Stops a run from one of its callbacks.
#[derive(Default)]
struct Stops {
    cancelled: Arc<AtomicBool>,
    /// Executions that may still end before it stops.
    ends: AtomicUsize,
    /// Whether the first step stops it.
    at_step: bool,
}

impl Progress for Stops {
    fn start(&self, _: usize, _: &str, _: usize, _: usize) {}
    fn step(&self, _: usize, _: usize, _: u64, _: u64) {
        if self.at_step {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }
    fn end(&self, _: usize, _: usize) {
        if self.ends.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn edits_run_what_follows_them_and_nothing_else() {
    let shot = Workspace::of("tensor.ron");
    let all: Vec<String> = shot.graph(SMALL).nodes.iter().map(|n| n.name.clone()).collect();
    assert_eq!(shot.run_small(&[]).nodes(), all);
    assert_eq!(shot.run_small(&[]).nodes(), [""; 0]);

    assert_eq!(shot.run_small(&["representatives.count=30"]).nodes(), AFTER_CLUSTERING);
    let clustering = [&["clusters"], AFTER_CLUSTERING].concat();
    assert_eq!(shot.run_small(&["clusters.seed=2"]).nodes(), clustering);
    let rows = [&["rows", "clusters"], AFTER_CLUSTERING].concat();
    assert_eq!(shot.run_small(&["rows.bins=(3, 3)"]).nodes(), rows);
    assert_eq!(shot.run_small(&["png.exposure=1.0"]).nodes(), ["png"]);

    // Lights are other lights: what the camera sees, and where it went, stays.
    let sun = ["sun", "photons", "bounce", "lights", "rows", "clusters"];
    assert_eq!(shot.run_small(&["sun.scale=0.2"]).nodes(), [&sun, AFTER_CLUSTERING].concat());
    let moved = shot.run_small(&["sun=(50.0, 100.0)"]);
    for node in ["scene", "geometry", "materials", "rest", "poses", "camera", "lanterns", "samples"]
    {
        assert!(!moved.nodes().contains(&node), "{node} ran after the sun moved");
    }
    assert!(moved.nodes().contains(&"sky_lights") && moved.nodes().contains(&"image"));

    // And back again, to what the first run left.
    assert_eq!(shot.run_small(&[]).nodes(), [""; 0]);
}

#[test]
fn a_longer_shot_runs_its_new_frames_only() {
    let shot = Workspace::of("tensor.ron");
    shot.run_small(&[]);
    let longer = shot.run_small(&["last=5"]);
    for node in ["poses", "camera", "framebuffer", "rows"] {
        assert_eq!(longer.ran(node), (2, 6), "{node}");
    }
    assert_eq!(longer.ran("maps"), (2, 5));
    assert_eq!((longer.ran("clusters"), longer.ran("scene")), ((1, 1), (0, 1)));
    assert_eq!(shot.run_small(&["last=2"]).ran("framebuffer"), (0, 3));
}

#[test]
fn text_names_and_places_do_not_count() {
    let mut shot = Workspace::of("tensor.ron");
    shot.run_small(&[]);
    shot.edit("fps: 20,", "fps: 2.0e1, /* slow */");
    shot.edit("Graph(\n", "Graph( // the shot\n\n\n");
    shot.edit("EmissiveLights(geometry", "EmissiveLights(seed: 1, geometry");
    shot.edit("\"smooth\"", "\"soft\"");
    shot.edit("\"size\"", "\"resolution\"");
    shot.edit("\"$size\"", "\"$resolution\"");
    let small: Vec<String> = SMALL.iter().map(|s| s.replace("size=", "resolution=")).collect();
    let small: Vec<&str> = small.iter().map(String::as_str).collect();
    assert_eq!(shot.run(&small).nodes(), [""; 0]);
    shot.move_to("elsewhere");
    assert_eq!(shot.run(&small).nodes(), [""; 0]);
}

/// A triangle, a camera and a lamp; the triangle is embedded.
const LAMP: &str = r#"{
  "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0, 1, 2] }],
  "extensionsUsed": ["KHR_lights_punctual"],
  "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 5.0 }] } },
  "nodes": [
    { "mesh": 0 },
    { "camera": 0 },
    { "translation": [0.5, 1.0, 0.0], "extensions": { "KHR_lights_punctual": { "light": 0 } } }
  ],
  "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
  "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
  "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
    "min": [-1, 0, -3], "max": [1, 1.5, -3] }],
  "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
  "buffers": [{ "byteLength": 36,
    "uri": "data:application/octet-stream;base64,AACAvwAAAAAAAEDAAACAPwAAAAAAAEDAAAAAAAAAwD8AAEDA" }]
}"#;

const LAMP_GRAPH: &str = r#"Graph(
    nodes: {
        "scene": Scene(file: "lamp.gltf"),
        "geometry": Geometry(scene: "scene"),
        "materials": Materials(scene: "scene"),
        "poses": Poses(scene: "scene"),
        "camera": Camera(scene: "scene"),
        "lamp": PunctualLights(scene: "scene"),
        "framebuffer": DeepFramebuffer(geometry: "geometry", materials: "materials", poses: "poses", camera: "camera", size: (16, 9)),
        "image": Reference(framebuffer: "framebuffer", lights: "lamp", geometry: "geometry", materials: "materials", poses: "poses"),
        "png": Png(image: "image"),
    },
    outputs: { "picture": "png" },
)"#;

#[test]
fn a_lamp_that_is_moved_or_dimmed_in_a_file_leaves_the_framebuffer_alone() {
    let mut still = Workspace::new(LAMP_GRAPH);
    still.write("lamp.gltf", LAMP);
    assert_eq!(still.run(&[]).nodes().len(), 9);
    let expected = ["scene", "geometry", "materials", "poses", "camera", "lamp", "image", "png"];
    // As many bytes, within the same second: the times of the file tell little.
    for (from, to) in [("5.0", "9.0"), ("[0.5, 1.0, 0.0]", "[0.9, 1.0, 0.0]")] {
        still.write("lamp.gltf", &LAMP.replace(from, to));
        assert_eq!(still.run(&[]).nodes(), expected, "{from} -> {to}");
    }
    still.write("lamp.gltf", LAMP);
    assert_eq!(still.run(&[]).nodes(), [""; 0]);

    // A file that says the same in other words: read again, and that is all that is new.
    still.write("lamp.gltf", &LAMP.replace('\n', "\n\n"));
    assert_eq!(still.run(&[]).nodes(), ["scene"]);
    still.move_to("elsewhere");
    fs::rename(still.path("lamp.gltf"), still.path("light.gltf")).unwrap();
    still.edit("lamp.gltf", "light.gltf");
    assert_eq!(still.run(&[]).nodes(), [""; 0]);
}

#[test]
fn a_damaged_blob_is_found_quarantined_and_made_again() {
    let shot = Workspace::of("tensor.ron");
    let first = shot.run_small(&[]);
    let (exr, rows) = (first.blob("exr", 2), first.blob("rows", 1));
    let whole = fs::read(&exr).unwrap();
    damage(&exr);
    let again = shot.run_small(&[]);
    assert_eq!((again.nodes(), again.ran("exr")), (vec!["exr"], (1, 4)));
    assert_eq!(fs::read(&exr).unwrap(), whole);
    let found = again.store.damage();
    assert_eq!((found.len(), &found[0].path), (1, &exr));
    assert_ne!(fs::read(found[0].moved.as_ref().unwrap()).unwrap(), whole);

    // Inside the graph, damage is found by who reads it; a blob that was cut short too.
    damage(&rows);
    let map = first.blob("maps", 0);
    fs::set_permissions(&map, Permissions::from_mode(0o644)).unwrap();
    fs::OpenOptions::new().write(true).open(&map).unwrap().set_len(100).unwrap();
    assert_eq!(shot.run_small(&[]).nodes(), [""; 0]);
    let again = shot.run_small(&["clusters.seed=2"]);
    assert_eq!(again.nodes(), [&["rows", "maps", "clusters"], AFTER_CLUSTERING].concat());
    assert_eq!((again.ran("rows"), again.ran("maps")), ((1, 4), (1, 3)));
    assert_eq!(again.store.damage().len(), 2);
    assert_eq!(again.held("rows"), first.held("rows"));
}

#[test]
fn a_deleted_blob_is_made_again_for_those_who_need_it() {
    let shot = Workspace::of("tensor.ron");
    let first = shot.run_small(&[]);
    fs::remove_file(first.blob("framebuffer", 2)).unwrap();
    fs::remove_file(first.blob("geometry", 0)).unwrap();
    assert_eq!(shot.run_small(&[]).nodes(), [""; 0]);
    let again = shot.run_small(&["representatives.count=30"]);
    assert_eq!(again.nodes(), [&["geometry", "framebuffer"], AFTER_CLUSTERING].concat());
    assert_eq!(again.ran("framebuffer"), (1, 4));
    assert!(again.store.damage().is_empty());
    // A chain of them: the picture needs the still, that the smooth images, and so on to the end. The
    // still has the bytes of a smooth image, so that it is there again before it is asked for.
    for node in ["png", "smooth", "image", "representatives"] {
        (0..first.held(node).len()).for_each(|k| fs::remove_file(first.blob(node, k)).unwrap());
    }
    let two = Options { jobs: 2, ..options() };
    let again = shot.attempt(SMALL, &[], &two, &Silent).unwrap();
    assert_eq!(again.nodes(), ["representatives", "image", "smooth", "png"]);

    // All of them, the records kept: the same results once more.
    fs::remove_dir_all(shot.path("cache/v1/cas")).unwrap();
    let again = shot.run_small(&[]);
    for (_, node) in &again.graph.outputs {
        let name = &again.graph.nodes[*node].name;
        assert_eq!(again.held(name), first.held(name), "{name}");
        assert!((0..again.held(name).len()).all(|k| again.blob(name, k).exists()), "{name}");
    }
    assert_eq!(shot.run_small(&[]).nodes(), [""; 0]);
}

#[test]
fn a_deleted_output_folder_is_filled_from_the_cache() {
    let shot = Workspace::of("tensor.ron");
    let folder = shot.path("out");
    let published = shot.run_small(&[]).publish(&folder);
    assert_eq!(published.len(), 6);
    let read =
        || -> Vec<Vec<u8>> { published.iter().map(|p| fs::read(&p.path).unwrap()).collect() };
    let before = read();
    fs::remove_dir_all(&folder).unwrap();
    let again = shot.run_small(&[]);
    again.publish(&folder);
    assert_eq!(again.nodes(), [""; 0]);
    assert!(read() == before, "the pictures are others than before");
    // One that somebody wrote over is written again, the others are left alone.
    let time = |k: usize| fs::metadata(&published[k].path).unwrap().modified().unwrap();
    let untouched = time(1);
    fs::write(&published[0].path, "mine").unwrap();
    shot.run_small(&[]).publish(&folder);
    assert!(read() == before, "a picture that was written over stays so");
    assert_eq!(time(1), untouched);
}

#[test]
fn a_node_that_fails_is_named_and_the_results_of_others_are_kept() {
    let toys = toys(
        r#""first": Combine(a: "frames"), "flaky": Trouble(a: "first", at: 2), "last": Combine(a: "flaky", plus: 1),"#,
    );
    let error = toys.run_nodes(&[], &["last"]).err().unwrap();
    assert_eq!(error.to_string(), "flaky (Trouble, frame 2) failed: 2 is what I was afraid of");
    assert!(matches!(error, EngineError::Node { .. }));
    let repaired = toys.run_nodes(&["flaky.at=-1"], &["last"]).unwrap();
    assert_eq!(
        (repaired.ran("first"), repaired.ran("flaky"), repaired.ran("last")),
        ((2, 5), (5, 5), (3, 5))
    );
    assert_eq!(repaired.numbers("last"), [1.0, 2.0, 3.0, 4.0, 5.0]);
}

#[test]
fn a_node_that_panics_is_an_error() {
    let toys =
        toys(r#""flaky": Trouble(a: "frames", at: 2, how: panic), "last": Combine(a: "flaky"),"#);
    for jobs in [1, 2] {
        let error =
            toys.attempt(&[], &["last"], &Options { jobs, ..options() }, &Silent).err().unwrap();
        let text = error.to_string();
        assert!(
            text.starts_with("flaky (Trouble, frame 2) failed: ") && text.contains("2 is a bug"),
            "{text}"
        );
    }
    assert_eq!(toys.run_nodes(&["flaky.at=-1"], &["last"]).unwrap().numbers("last").len(), 5);
}

#[test]
fn a_failure_leaves_the_options_of_the_caller_alone() {
    let toys = toys(r#""flaky": Trouble(a: "frames", at: 2),"#);
    let options = options();
    assert!(toys.attempt(&[], &["flaky"], &options, &Silent).is_err());
    assert!(!options.cancelled.load(Ordering::Relaxed), "nobody asked the run to stop");
    assert_eq!(
        toys.attempt(&["flaky.at=-1"], &["flaky"], &options, &Silent)
            .unwrap()
            .numbers("flaky")
            .len(),
        5
    );
}

#[test]
fn a_failure_stops_what_runs_beside_it() {
    let toys = toys(
        r#""flaky": Trouble(a: "frames", at: 1), "endless": Trouble(a: "frames", at: 0, how: endless),"#,
    );
    let error = toys
        .attempt(&[], &["flaky", "endless"], &Options { jobs: 2, ..options() }, &Silent)
        .err()
        .unwrap();
    assert_eq!(error.to_string(), "flaky (Trouble, frame 1) failed: 1 is what I was afraid of");
}

#[test]
fn a_run_that_is_stopped_goes_on_where_it_was() {
    let tag = tag();
    let toys =
        toys(&format!(r#""slow": Combine(a: "frames", tag: {tag}), "last": Combine(a: "slow"),"#));
    // The frames, and slow and last of frame 0 and 1.
    let stops = Stops { ends: AtomicUsize::new(5), ..Stops::default() };
    let options = Options { cancelled: Arc::clone(&stops.cancelled), ..options() };
    let error = toys.attempt(&[], &["last"], &options, &stops).err().unwrap();
    assert!(matches!(error, EngineError::Cancelled));
    assert_eq!(runs_of(tag), 2);
    let rest = toys.run_nodes(&[], &["last"]).unwrap();
    assert_eq!((rest.ran("slow"), rest.ran("last"), runs_of(tag)), ((3, 5), (3, 5), 5));
}

#[test]
fn a_node_under_way_is_stopped_too() {
    let toys = toys(r#""endless": Trouble(a: "frames", at: 0, how: endless),"#);
    let stops = Stops { at_step: true, ..Stops::default() };
    let options = Options { cancelled: Arc::clone(&stops.cancelled), ..options() };
    let error = toys.attempt(&[], &["endless"], &options, &stops).err().unwrap();
    assert!(matches!(error, EngineError::Cancelled));
    assert_eq!(toys.run_nodes(&["endless.at=-1"], &["endless"]).unwrap().ran("endless"), (5, 5));
}

#[test]
fn two_runs_of_one_graph_compute_each_key_once() {
    let tag = tag();
    let toys = toys(&format!(
        r#""slow": Combine(a: "frames", tag: {tag}, takes: 10), "sums": Running(items: "slow", tag: {tag}),
           "last": Combine(a: "sums", b: "slow", tag: {tag}, takes: 5),"#
    ));
    let run = || {
        let options = Options { jobs: 2, ..options() };
        toys.attempt(&[], &["last"], &options, &Silent).unwrap()
    };
    let (one, two) = std::thread::scope(|scope| {
        let other = scope.spawn(run);
        (run(), other.join().unwrap())
    });
    // Sums of chunks: 0 1 | 2 5 | 4.
    assert_eq!(one.numbers("last"), [0.0, 1.0, 4.0, 15.0, 16.0]);
    assert_eq!(one.held("last"), two.held("last"));
    assert_eq!(runs_of(tag), 5 + 3 + 5);
    assert_eq!(one.summary.ran().0 + two.summary.ran().0, 1 + 5 + 3 + 5);
}

#[test]
fn equal_executions_of_one_run_are_computed_once() {
    let tag = tag();
    // The number 7 in every frame, and by two nodes.
    let toys = toys(&format!(
        r#""zero": Combine(plus: 0), "same": Combine(a: "frames", b: "zero", plus: 7),
           "one": Combine(a: "same", tag: {tag}), "two": Combine(a: "same", tag: {tag}),"#
    ));
    toys.edit("\"zero\": Combine(plus: 0)", "\"zero\": Combine(plus: -1)");
    for jobs in [1, 3] {
        let ran =
            toys.attempt(&[], &["one", "two"], &Options { jobs, ..options() }, &Silent).unwrap();
        assert_eq!((ran.numbers("one"), ran.numbers("two")), (vec![7.0; 5], vec![7.0; 5]));
        assert_eq!(runs_of(tag), 1);
    }
}

#[test]
fn a_wrong_number_of_items_is_an_error() {
    let toys = toys(r#""sums": Running(items: "frames", missing: 1),"#);
    let error = toys.run_nodes(&[], &["sums"]).err().unwrap().to_string();
    assert_eq!(error, "sums (Running, chunk 0) failed: gave 1 items where 2 were expected");
    assert_eq!(
        toys.run_nodes(&["sums.missing=0"], &["sums"]).unwrap().numbers("sums"),
        [0.0, 1.0, 2.0, 5.0, 4.0]
    );
}

#[test]
fn sequences_have_known_numbers() {
    let toys = toys(
        r#""seven": Combine(plus: 6),
           "scaled": Combine(a: "frames", b: "seven"),
           "squares": Combine(a: "frames", b: "frames"),
           "steps": Step(items: "squares"),
           "doubled": Combine(a: "steps", plus: 1),
           "totals": Total(items: "squares"),
           "step_totals": Total(items: "steps"),
           "after": Combine(a: "totals", b: "step_totals", plus: 0.5),
           "sums": Running(items: "squares"),
           "both": Combine(a: "sums", b: "frames"),
           "single": Total(items: "seven"),"#,
    );
    let wanted =
        ["scaled", "steps", "doubled", "totals", "step_totals", "after", "sums", "both", "single"];
    let ran = toys.run_nodes(&[], &wanted).unwrap();
    let expected: [&[f64]; 9] = [
        &[0.0, 7.0, 14.0, 21.0, 28.0],
        // Frames 0 and 1, 2 and 3; the last chunk has no pair, and none reaches across.
        &[1.0, 5.0],
        &[2.0, 6.0],
        // 0 + 1, 4 + 9, 16.
        &[1.0, 13.0, 16.0],
        &[1.0, 5.0, 0.0],
        &[1.5, 65.5, 0.5],
        &[0.0, 1.0, 4.0, 13.0, 16.0],
        &[0.0, 1.0, 8.0, 39.0, 64.0],
        &[7.0],
    ];
    for (node, numbers) in wanted.iter().zip(expected) {
        assert_eq!(ran.numbers(node), numbers, "{node}");
    }
    assert_eq!((ran.ran("squares"), ran.ran("steps"), ran.ran("sums")), ((5, 5), (2, 2), (3, 3)));

    // A chunk less, and other chunks of the same frames.
    let ran = toys.run_nodes(&["frames.last=3"], &wanted).unwrap();
    assert_eq!((ran.ran("squares"), ran.ran("totals"), ran.ran("sums")), ((0, 4), (0, 2), (0, 2)));
    let ran = toys.run_nodes(&["frames.chunk=3"], &wanted).unwrap();
    assert_eq!((ran.ran("scaled"), ran.ran("steps"), ran.ran("totals")), ((0, 5), (2, 3), (2, 2)));
    assert_eq!(
        (ran.numbers("steps"), ran.numbers("totals")),
        (vec![1.0, 3.0, 7.0], vec![5.0, 25.0])
    );
}

#[test]
fn estimates_beyond_the_limit_never_run_side_by_side() {
    let run = |memory: u64, bytes: u64, waits: u64| {
        let tag = tag();
        let toys = toys(&format!(
            r#""heavy": Heavy(a: "frames", bytes: {bytes}, waits: {waits}, tag: {tag}),"#
        ));
        let options = Options { jobs: 4, memory, ..options() };
        toys.attempt(&[], &["heavy"], &options, &Silent).unwrap();
        most_at_once(tag)
    };
    assert_eq!(run(1000, 600, 40), 1);
    // More than the limit by itself: alone.
    assert_eq!(run(1000, 5000, 40), 1);
    assert!(run(1000, 400, 5000) >= 2);
}

#[test]
fn extreme_estimates_do_not_overflow() {
    let tag = tag();
    let toys = toys(&format!(
        r#""huge": Heavy(a: "frames", bytes: 18446744073709551615, waits: 20, tag: {tag}), "small": Combine(a: "frames", takes: 5),"#
    ));
    let options = Options { jobs: 3, memory: u64::MAX, ..options() };
    let ran = toys.attempt(&[], &["huge", "small"], &options, &Silent).unwrap();
    assert_eq!((ran.ran("huge"), ran.ran("small")), ((5, 5), (5, 5)));
}
