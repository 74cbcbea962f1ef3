//! Reports and comparisons as a user meets them.

use crate::cli::{ask, code, errors, json};
use crate::sweep::{GRID, SMALL, figures, sweep};
use std::fs;

#[test]
fn a_report_is_one_page_for_sweeps_and_runs() {
    let project = sweep(1, GRID);
    let nothing = ask(&project, &["report", "sweep.ron"]);
    assert!(code(&nothing) == 3 && errors(&nothing).contains("lightloom sweep sweep.ron"));
    assert_eq!(code(&ask(&project, &["sweep", "sweep.ron", "--json"])), 0);
    let told = json(&ask(&project, &["report", "sweep.ron", "--json"]));
    assert_eq!(told["written"][0], "out/sweep/report.html");
    let page = fs::read_to_string(project.path("out/sweep/report.html")).unwrap();
    assert!(page.len() < 5_000_000 && page.contains("tensor_error.relative_l2"));

    let sets: Vec<String> = SMALL
        .lines()
        .skip(1)
        .take(3)
        .flat_map(|l| l.split(", \""))
        .map(|s| s.trim().trim_end_matches(',').replace('"', "").replacen(": ", "=", 1))
        .collect();
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    let run =
        [&["run", "graph.ron", "--json", "--set", "last=1", "--set", "columns=20"][..], &sets]
            .concat();
    let ran = ask(&project, &run);
    assert_eq!(code(&ran), 0, "{}", errors(&ran));
    let report =
        [&["report", "graph.ron", "--json", "--set", "last=1", "--set", "columns=20"][..], &sets]
            .concat();
    let told = ask(&project, &report);
    assert_eq!(code(&told), 0, "{}", errors(&told));
    let document = figures(&project.path("out/graph"));
    assert_eq!(
        (&document["points"][0]["fate"], document["axes"].as_array().unwrap().len()),
        (&"done".into(), 0)
    );
    assert!(document["points"][0]["graph"].as_str().unwrap().contains("\"columns\": 20,"));
}

#[test]
fn runs_points_and_files_are_compared() {
    let project = sweep(1, GRID);
    assert_eq!(code(&ask(&project, &["sweep", "sweep.ron", "--json"])), 0);
    let told = json(&ask(&project, &["compare", "sweep.ron:0", "sweep.ron:2", "--json"]));
    assert_eq!(told["changes"], serde_json::json!(["tensor_representatives.count 10 -> 40"]));
    assert!(
        told["figures"]["relative_l2"].as_f64().unwrap() > 0.0
            && told["figures"]["jod"].is_number()
    );
    assert!(told["cost"][1]["evaluations"].as_u64() > told["cost"][0]["evaluations"].as_u64());
    assert!(
        fs::read_to_string(project.path("out/compare/report.html"))
            .unwrap()
            .contains("sweep.ron:2")
    );

    let same = json(&ask(&project, &["compare", "sweep.ron:1", "sweep.ron:1", "--json"]));
    let figures = &same["figures"];
    let expected = [
        ("relative_l2", 0.0),
        ("energy", 1.0),
        ("ssim", 1.0),
        ("flip", 0.0),
        ("jod", 10.0),
        ("psnr", 200.0),
    ];
    for (name, value) in expected {
        assert!((figures[name].as_f64().unwrap() - value).abs() < 1e-9, "{name} in {figures}");
    }
    let truth = json(&ask(
        &project,
        &["compare", "sweep.ron:1", "sweep.ron:1", "--node", "truth", "--json"],
    ));
    assert_eq!(truth["figures"]["relative_l2"], 0.0);

    // The same images from files: what was published and read again is the same to the bit.
    project.write(
        "graph.ron",
        &fs::read_to_string(project.path("graph.ron"))
            .unwrap()
            .replace("outputs: {", "outputs: { \"frame\": \"exr\", ")
            .replace(
                "\"tensor_still\":",
                "\"exr\": Exr(image: \"tensor\"),\n        \"tensor_still\":",
            ),
    );
    let run = [
        "run",
        "graph.ron",
        "--set",
        "last=1",
        "--set",
        "size=(48, 27)",
        "--set",
        "lights=300",
        "--set",
        "scene.detail=0.3",
        "--set",
        "sky_lights.count=128",
        "--set",
        "lanterns.count=48",
        "--set",
        "samples.count=240",
        "--set",
        "photons.count=500",
        "--set",
        "still=0",
        "--out",
        "frames",
    ];
    let ran = ask(&project, &run);
    assert_eq!(code(&ran), 0, "{}", errors(&ran));
    let folder = json(&ask(&project, &["compare", "frames", "frames", "--json"]));
    assert_eq!((&folder["figures"]["flicker"], folder["ok"].as_bool()), (&0.0.into(), Some(true)));
    let files = json(&ask(
        &project,
        &["compare", "frames/frame.0000.exr", "frames/frame.0001.exr", "--json"],
    ));
    assert!(files["figures"]["relative_l2"].as_f64().unwrap() > 0.0);

    for (wrong, exit, part) in [
        (["sweep.ron:9", "sweep.ron:1"], 3, "it has 6, counted from 0"),
        (["sweep.ron", "sweep.ron:1"], 2, "name one of its points"),
        (["frames", "frames/frame.0000.exr"], 1, "there are 2 images but 1 references"),
        (["nothing.exr", "frames"], 2, "nothing.exr"),
        (["graph.ron", "frames"], 3, "is not in the cache: lightloom run graph.ron"),
    ] {
        let told = ask(&project, &["compare", wrong[0], wrong[1]]);
        assert!(
            code(&told) == exit && errors(&told).contains(part),
            "{wrong:?}: {}",
            errors(&told)
        );
    }
}
