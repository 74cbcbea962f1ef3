//! The engine through the library: what runs again after what, and what survives. How runs fail, stop and share is in `runs`.

use crate::workspace::{SMALL, Silent, Workspace, options};
use lightloom::engine::Options;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// What follows the clustering in the tensor graph.
const AFTER_CLUSTERING: &[&str] =
    &["representatives", "image", "smooth", "exr", "still", "png", "preview"];

/// Changes one byte of a file, in the middle of it.
fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let at = bytes.len() / 2;
    bytes[at] ^= 0x10;
    fs::set_permissions(path, Permissions::from_mode(0o644)).unwrap();
    fs::write(path, bytes).unwrap();
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
