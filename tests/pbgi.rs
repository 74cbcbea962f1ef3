//! Quantized point-based global illumination, from surfels to the picture.

use crate::workspace::{Ran, Workspace};
use lightloom::nodes::data::{Comparison, Image, Lut, PbgiMemory, PbgiTree, QuantizationError};

/// `graphs/pbgi_quantized.ron`, made small.
const SMALL: &[&str] = &[
    "size=(32, 18)",
    "surfels=6000",
    "scene.detail=0.3",
    "sky_lights.count=32",
    "lanterns.count=16",
];

fn small<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [SMALL, more].concat()
}

#[test]
fn a_table_of_every_vector_loses_nothing() {
    let project = Workspace::of("pbgi_quantized.ron");
    let ran = project.run(&small(&["entries=100000", "from=surfels", "subset=1.0", "format=a"]));
    let lost: QuantizationError = ran.artifact("quantization", 0);
    // Nearly black vectors are one entry of zeros.
    assert!(lost.mean_l2 < 1e-4, "{}", lost.mean_l2);
    let error: Comparison = ran.artifact("error", 0);
    assert!(error.relative_l2[0] < 1e-3 && error.psnr[0] > 66.0, "{} dB", error.psnr[0]);
}

#[test]
fn more_entries_lose_less_and_k_means_less_than_chance() {
    let project = Workspace::of("pbgi_quantized.ron");
    let lost = |entries: &str, iterations: &str| -> f64 {
        let set = [format!("entries={entries}"), format!("iterations={iterations}")];
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let ran = project.run_nodes(&small(&set), &["quantization"]).unwrap();
        ran.artifact::<QuantizationError>("quantization", 0).mean_l2
    };
    let [few, more] = ["20", "300"].map(|entries| (lost(entries, "10"), lost(entries, "0")));
    assert!(
        few.0 < few.1 && more.0 < more.1,
        "k-means {} {}, random {} {}",
        few.0,
        more.0,
        few.1,
        more.1
    );
    assert!(more.0 < 0.6 * few.0, "{} {}", few.0, more.0);
}

#[test]
fn formats_and_shapes_give_the_same_picture() {
    let project = Workspace::of("pbgi_quantized.ron");
    let image = |set: &[&str]| -> Image {
        project.run_nodes(&small(set), &["indirect"]).unwrap().artifact("indirect", 0)
    };
    let distance = |a: &Image, b: &Image| {
        let pairs = || a.radiance.iter().zip(b.radiance.iter());
        let difference: f64 = pairs().map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
        let norm: f64 = pairs().map(|(_, b)| f64::from(b.length_squared())).sum();
        (difference / norm).sqrt()
    };
    let a = image(&["format=a"]);
    for (set, most) in [("format=b", 0.1), ("format=c", 0.2), ("tree.shape=octree", 0.15)] {
        let other = image(&["format=a", set]);
        assert!(distance(&other, &a) < most, "{set}: {}", distance(&other, &a));
    }
}

#[test]
fn memory_is_told_as_the_paper_counts_and_in_truth() {
    let project = Workspace::of("pbgi_quantized.ron");
    let mut stored = Vec::new();
    for format in ["format=a", "format=b", "format=c"] {
        let ran = project.run_nodes(&small(&["entries=100", format]), &["memory", "tree"]).unwrap();
        let memory: PbgiMemory = ran.artifact("memory", 0);
        let tree: PbgiTree = ran.artifact("tree", 0);
        let surfels = f64::from(tree.leaves);
        assert!((memory.paper_vectors * 1e6 / surfels - 108.0).abs() < 1e-9);
        assert!((memory.paper_full * 1e6 / surfels - 146.0).abs() < 1e-9);
        // What is said to be stored is what the artifact has, but for a few numbers of the whole tree.
        let blob = std::fs::metadata(ran.blob("tree", 0)).unwrap().len() as f64;
        assert!((blob - memory.stored * 1e6).abs() < 6000.0, "{blob} {}", memory.stored);
        stored.push(memory.paper_ratio);
    }
    assert!(stored[0] > 3.6 && stored[1] > 4.9 && stored[2] > 7.9, "{stored:?}");
}

#[test]
fn another_bounce_adds_light_and_less_than_the_first() {
    let project = Workspace::of("pbgi.ron");
    let more = "\"lit2\": ShadeSurfels(surfels: \"surfels\", geometry: \"geometry\", materials: \"materials\", poses: \"poses\", lights: \"lights\", tree: \"tree\"),
        \"tree2\": PbgiTree(surfels: \"lit2\"),
        \"indirect2\": PbgiGather(tree: \"tree2\", framebuffer: \"framebuffer\", environment: \"sky\"),
        \"indirect\": PbgiGather";
    project.edit("\"indirect\": PbgiGather", more);
    let ran = project.run_nodes(SMALL, &["indirect", "indirect2"]).unwrap();
    let sum = |name: &str| -> f64 {
        let image: Image = ran.artifact(name, 0);
        assert!(image.radiance.iter().all(|p| p.is_finite()));
        image.radiance.iter().map(|p| f64::from(p.element_sum())).sum()
    };
    let (one, two) = (sum("indirect"), sum("indirect2"));
    assert!(two > 1.02 * one && two < 2.0 * one, "{one} {two}");
}

/// How pink the pinkest entry of a table is: its mean red over its mean green.
fn pinkest(ran: &Ran) -> f32 {
    let lut: Lut = ran.artifact("lut", 0);
    let functions = (lut.bands * lut.bands) as usize;
    let rows = lut.entries.chunks_exact(4 * functions);
    let bright = rows.filter(|row| row[0] > 1e-3);
    bright.map(|row| row[0] / row[functions].max(1e-6)).fold(0.0, f32::max)
}

#[test]
fn a_table_of_too_few_surfels_has_no_rare_colour() {
    let project = Workspace::of("pbgi_meadow.ron");
    let pink = |more: &[&str]| {
        let small = ["surfels=100000", "scene.detail=0.5", "sky_lights.count=4", "entries=2000"];
        pinkest(&project.run_nodes(&[&small, more].concat(), &["lut"]).unwrap())
    };
    // Caps reflect eight times as much red as green; nothing else more than twice.
    let few = pink(&["from=surfels", "subset=0.001"]);
    let many = pink(&["from=surfels", "subset=1.0"]);
    let nodes = pink(&["from=nodes"]);
    assert!(few < 2.0 && many > 3.0 && nodes > 3.0, "{few} {many} {nodes}");
}

#[test]
fn a_shot_has_one_table_or_one_for_each_frame() {
    let project = Workspace::of("pbgi_meadow.ron");
    let small =
        ["last=2", "surfels=3000", "scene.detail=0.3", "scene.grass=200", "sky_lights.count=4"];
    let set = [&small[..], &["entries=50", "size=(32, 18)"]].concat();
    let shared = project.run_nodes(&set, &["lut", "error"]).unwrap();
    let error: Comparison = shared.artifact("error", 0);
    assert_eq!(error.relative_l2.len(), 3);
    assert!(error.relative_l2.iter().all(|e| *e < 0.2), "{:?}", error.relative_l2);
    let node = shared.graph.nodes.iter().position(|node| node.name == "lut").unwrap();
    assert_eq!(shared.known.held[node].len(), 1);
    project.edit("Lut(shot:", "Lut(surfels:");
    let each = project.run_nodes(&set, &["lut"]).unwrap();
    assert_eq!(each.known.held[node].len(), 3);
}
