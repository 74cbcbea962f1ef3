//! The committed sweeps that make the tables and figures of Buchholz and Boubekeur (2012), each at a small setting.

use crate::cli::{ask, code, errors, json};
use crate::workspace::{Workspace, graphs};
use serde_json::Value;
use std::fs;

/// The points of a committed sweep over a graph, made small by replacing `from` with `to`. All of them are done.
fn points(sweep: &str, graph: &str, small: &[(&str, &str)]) -> Vec<Value> {
    let project = Workspace::of(graph);
    let mut text = fs::read_to_string(graphs().join("sweeps").join(sweep)).unwrap();
    let to_graph = format!("../{graph}");
    for (from, to) in [&[(to_graph.as_str(), "graph.ron")], small].concat() {
        assert!(text.contains(from), "{sweep} has no {from}");
        text = text.replace(from, to);
    }
    project.write("sweep.ron", &text);
    let swept = ask(&project, &["sweep", "sweep.ron", "--json"]);
    assert_eq!(code(&swept), 0, "{sweep}: {}", errors(&swept));
    let results = fs::read_to_string(project.path("out/sweep/results.json")).unwrap();
    let results: Value = serde_json::from_str(&results).unwrap();
    let points = results["points"].as_array().unwrap().clone();
    let settings = results["settings"].as_array().unwrap();
    assert!(json(&swept).is_object() && points.iter().all(|point| point["fate"] == "done"));
    let of_point = |mut point: Value| {
        let setting = point["setting"].as_u64().unwrap() as usize;
        point["values"] = settings[setting]["values"].clone();
        point
    };
    points.into_iter().map(of_point).collect()
}

fn figure(point: &Value, name: &str) -> f64 {
    point["figures"][name].as_f64().unwrap_or_else(|| panic!("no {name} in {point}"))
}

const SCENE: &str = r#""scene.detail": 0.3, "sky_lights.count": 4,"#;
const ENTRIES: (&str, &str) = ("[100, 1000, 10000]", "[20, 60, 200]");

#[test]
fn table_1_compresses_as_formats_say() {
    let set = format!(r#"{SCENE} "surfels": 6000"#);
    let small = [(r#""surfels": 10000000, "sky_lights.count": 1"#, set.as_str()), ENTRIES];
    let points = points("pbgi_memory.ron", "pbgi_quantized.ron", &small);
    let [a, b, c] = ["a", "b", "c"].map(|format| {
        let of = points.iter().filter(|point| point["values"][0] == format);
        of.map(|point| figure(point, "memory.paper_ratio")).collect::<Vec<f64>>()
    });
    // The more entries, the more bits an index has; 20 and 60 have 5 and 6.
    assert!(a.is_sorted_by(|x, y| x > y) && c.is_sorted_by(|x, y| x > y), "{a:?} {c:?}");
    assert!(a[0] > 3.7 && b[0] > 5.0 && c[0] > 8.0, "{a:?} {b:?} {c:?}");
}

#[test]
fn table_3_has_the_time_of_table_and_tree() {
    let set = format!(r#"{SCENE} "surfels": 6000"#);
    let small = [(r#""surfels": 5000000, "sky_lights.count": 1"#, set.as_str()), ENTRIES];
    let points = points("pbgi_times.ron", "pbgi_quantized.ron", &small);
    assert_eq!(points.len(), 3);
    for point in &points {
        assert!(point["cpu_seconds"].as_f64() > Some(0.0), "{point}");
        assert!(figure(point, "memory.stored") < 0.5 * figure(point, "plain_memory.stored"));
    }
}

#[test]
fn figures_4_and_5_favour_k_means_over_chance() {
    let set = format!(r#"{SCENE} "lanterns.count": 16, "size": (32, 18), "surfels": 8000"#);
    let small = [(r#""size": (160, 90), "surfels": 400000"#, set.as_str()), ENTRIES];
    let points = points("pbgi_entries.ron", "pbgi_quantized.ron", &small);
    assert_eq!(points.len(), 12);
    let error = |iterations: &str, entries: &str| {
        let wanted = ["surfels", iterations, entries];
        let at = points.iter().find(|point| point["values"] == serde_json::json!(wanted));
        figure(at.expect("a point of the grid"), "quantization.mean_l1")
    };
    for entries in ["20", "60", "200"] {
        let (learned, drawn) = (error("10", entries), error("0", entries));
        assert!(learned < drawn, "{entries}: {learned} {drawn}");
    }
    assert!(error("10", "200") < 0.7 * error("10", "20"));
}

#[test]
fn figure_6_needs_enough_surfels_to_learn_from() {
    let set = r#""from": surfels, "surfels": 20000, "size": (32, 18), "scene.detail": 0.3, "scene.grass": 200,
        "sky_lights.count": 4, "entries": 100"#;
    let small = [(r#""from": surfels"#, set), ("[1, 2, 3]", "[1]")];
    let points = points("pbgi_subset.ron", "pbgi_meadow.ron", &small);
    let errors: Vec<f64> =
        points.iter().map(|point| figure(point, "quantization.mean_l1")).collect();
    assert!(errors.len() == 3 && errors[2] < errors[0], "{errors:?}");
}
