//! Sweeps as a user meets them: what is counted, shared, resumed and reported.

use crate::cli::{ask, code, errors, json, lightloom, reaches, results};
use crate::workspace::Workspace;
use lightloom::store::Store;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

/// `graphs/reference.ron`, made small.
pub const SMALL: &str = r#"set: {
        "size": (48, 27), "lights": 300, "still": 0, "scene.detail": 0.3, "sky_lights.count": 128,
        "lanterns.count": 48, "samples.count": 240, "photons.count": 500, "tensor_clusters.start": 20,
        "tensor_clusters.limit": 60,
    },
    measure: ["tensor_error", "tensor_flip"], cost: ["tensor"], pictures: ["tensor_png", "truth_png"],"#;

/// A project with the reference graph and a sweep over it: `last` is the shot's last frame.
pub fn sweep(last: usize, rest: &str) -> Workspace {
    let project = Workspace::of("reference.ron");
    let small = SMALL.replace("set: {", &format!("set: {{ \"last\": {last},"));
    project.write(
        "sweep.ron",
        &format!("Sweep(\n    graph: \"graph.ron\",\n    {small}\n    {rest}\n)"),
    );
    project
}

pub const GRID: &str = r#"axes: [Grid({ "rows": [(3, 3), (4, 4)], "columns": [10, 20, 40] })],"#;

/// How often a node of a name was computed. A record is one item; of several given at once, each has its own.
fn computed(project: &Workspace, cache: &str) -> BTreeMap<String, usize> {
    let mut count = BTreeMap::new();
    for (_, record) in Store::open(&project.path(cache), None).unwrap().records() {
        *count.entry(record.name).or_default() += 1;
    }
    count
}

/// The results without what cannot be the same twice: times and memory.
pub fn figures(folder: &Path) -> Value {
    let text = fs::read_to_string(folder.join("results.json")).unwrap();
    let mut document: Value = serde_json::from_str(&text).unwrap();
    const TIMES: [&str; 8] = [
        "made",
        "cpu_seconds",
        "seconds",
        "together",
        "peak_bytes",
        "front_cpu_seconds",
        "other_host",
        "source",
    ];
    fn strip(value: &mut Value) {
        match value {
            Value::Object(map) => {
                map.retain(|name, _| !TIMES.contains(&&**name));
                map.values_mut().for_each(strip);
            }
            Value::Array(values) => values.iter_mut().for_each(strip),
            _ => {}
        }
    }
    strip(&mut document);
    document
}

#[test]
fn the_counts_are_exact_and_one_clustering_serves_all_columns() {
    // One frame, so that no two executions can turn out equal.
    let project = sweep(0, GRID);
    let planned = json(&ask(&project, &["sweep", "sweep.ron", "--plan", "--json"]));
    let swept = ask(&project, &["sweep", "sweep.ron", "--json"]);
    assert_eq!(code(&swept), 0, "{}", errors(&swept));
    let swept = json(&swept);
    let (distinct, apart) = (&planned["distinct_runs"], &planned["runs_apart"]);
    assert_eq!((&swept["ran"], &swept["work"]["distinct_runs"]), (distinct, distinct));
    let count = computed(&project, ".lightloom");
    assert_eq!(count.values().sum::<usize>() as u64, distinct.as_u64().unwrap());
    assert_eq!((count["tensor_clusters"], count["tensor"], count["truth"]), (2, 6, 1));

    // As many as the points would run by themselves, each in a cache of its own.
    let mut alone = 0;
    for (k, rows) in ["(3, 3)", "(4, 4)"].iter().enumerate() {
        for columns in [10, 20, 40] {
            let one = format!("axes: [List([{{ \"rows\": {rows}, \"columns\": {columns} }}])],");
            let text = fs::read_to_string(project.path("sweep.ron")).unwrap().replace(GRID, &one);
            project.write("one.ron", &text);
            let cache = format!("cache-{k}-{columns}");
            let ran =
                json(&ask(&project, &["sweep", "one.ron", "--plan", "--json", "--cache", &cache]));
            assert_eq!(ran["distinct_runs"], ran["runs_apart"]);
            alone += ran["distinct_runs"].as_u64().unwrap();
        }
    }
    assert_eq!(apart.as_u64(), Some(alone));

    let again = json(&ask(&project, &["sweep", "sweep.ron", "--json"]));
    assert_eq!((&again["ran"], &again["work"]["done_before"]), (&0.into(), distinct));
}

#[test]
fn one_pass_gives_the_bits_of_many() {
    let together = sweep(2, GRID);
    let apart = sweep(2, &format!("{GRID} limits: (apart: true)"));
    for project in [&together, &apart] {
        let swept = ask(project, &["sweep", "sweep.ron", "--json"]);
        assert_eq!(code(&swept), 0, "{}", errors(&swept));
    }
    let results = |project: &Workspace| results(&project.path(".lightloom"));
    assert!(results(&together) == results(&apart));
    let figures = |project: &Workspace| figures(&project.path("out/sweep"));
    assert_eq!(figures(&together), figures(&apart));
    let alone = |project: &Workspace| {
        let store = Store::open(&project.path(".lightloom"), None).unwrap();
        let images = store.records().filter(|(_, r)| r.name == "tensor");
        images.map(|(_, r)| r.alone).collect::<Vec<_>>()
    };
    assert_eq!((alone(&together), alone(&apart)), (vec![false; 18], vec![true; 18]));
}

#[test]
fn a_sweep_that_is_killed_ten_times_ends_with_the_same_table() {
    let project = sweep(3, GRID);
    let whole =
        ask(&project, &["sweep", "sweep.ron", "--cache", "whole", "--out", "whole-out", "--json"]);
    assert_eq!(code(&whole), 0, "{}", errors(&whole));
    let cache = project.path("killed");
    let mut kills = 0;
    for (round, count) in [2, 9, 17, 25, 33, 41, 50, 58, 66, 75].into_iter().enumerate() {
        let mut command = lightloom(&project);
        command.args(["sweep", "sweep.ron", "--cache", "killed", "--out", "killed-out", "--json"]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        if reaches(&mut child, &cache, count) {
            // Not always at the same moment of an action.
            sleep(Duration::from_millis(round as u64));
            kills += 1;
        }
        child.kill().ok();
        child.wait().unwrap();
    }
    assert_eq!(kills, 10, "the sweep ended before it was killed");
    let last = ask(
        &project,
        &["sweep", "sweep.ron", "--cache", "killed", "--out", "killed-out", "--json"],
    );
    assert_eq!((code(&last), errors(&last)), (0, String::new()));
    assert_eq!(figures(&project.path("killed-out")), figures(&project.path("whole-out")));
    let csv = |folder: &str| {
        let text = fs::read_to_string(project.path(folder).join("results.csv")).unwrap();
        let mut lines = text.lines().map(|l| l.split(',').map(str::to_owned).collect::<Vec<_>>());
        lines.next().unwrap()
    };
    assert_eq!(csv("killed-out"), csv("whole-out"));
    assert!(results(&cache) == results(&project.path("whole")));
}

#[test]
fn a_failed_point_is_told_and_leaves_the_others_alone() {
    let project =
        sweep(1, r#"axes: [Grid({ "tensor_still.frame": [0, 7], "columns": [10, 20] })],"#);
    let swept = ask(&project, &["sweep", "sweep.ron"]);
    let (told, table) = (errors(&swept), String::from_utf8(swept.stdout.clone()).unwrap());
    assert_eq!(code(&swept), 1, "{told}");
    assert!(told.contains("failed: tensor_still (Still"), "{told}");
    assert!(told.contains("so does tensor_still.frame=7 columns=10"), "{told}");
    assert!(told.contains("2 of 4 points failed"), "{told}");
    assert!(table.contains("failed: 7 10: tensor_still"), "{table}");
    let document: Value =
        serde_json::from_slice(&fs::read(project.path("out/sweep/results.json")).unwrap()).unwrap();
    let fates: Vec<&str> = document["points"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| p["fate"].as_str().unwrap())
        .collect();
    assert_eq!(fates, ["done", "done", "failed", "failed"]);
    // It is not kept: it fails again, and nothing else runs.
    let again = json(&ask(&project, &["sweep", "sweep.ron", "--json"]));
    assert_eq!((&again["failed"], &again["ran"]), (&2.into(), &0.into()));
    // Without going on, the first failure ends it.
    let text = fs::read_to_string(project.path("sweep.ron")).unwrap();
    project.write("stop.ron", &text.replace("axes:", "limits: (keep_going: false), axes:"));
    let stopped = ask(&project, &["sweep", "stop.ron", "--json"]);
    assert_eq!((code(&stopped), &json(&stopped)["ok"]), (1, &false.into()));
}

#[test]
fn seeds_give_error_bars_and_shots_of_other_lengths_share_what_they_can() {
    let rest = r#"axes: [Zip({ "tensor_clusters.time_weight": [1.0, 2.0], "columns": [10, 20] })], seeds: { "seed": [1, 2, 3] },"#;
    let project = sweep(1, rest);
    let swept = ask(&project, &["sweep", "sweep.ron", "--json"]);
    assert_eq!(code(&swept), 0, "{}", errors(&swept));
    let document = figures(&project.path("out/sweep"));
    assert_eq!(document["settings"].as_array().unwrap().len(), 2);
    let error = &document["settings"][0]["figures"]["tensor_error.relative_l2"];
    assert!(error["count"] == 3 && error["deviation"].as_f64().unwrap() > 0.0, "{error}");

    // Frames 0 and 1 are those of the shorter shot.
    let longer = sweep(1, r#"axes: [List([{ "frames.last": 1 }, { "frames.last": 2 }])],"#);
    let counted = json(&ask(&longer, &["sweep", "sweep.ron", "--json"]));
    assert_eq!(counted["ok"], true, "{counted}");
    let count = computed(&longer, ".lightloom");
    assert_eq!((count["framebuffer"], count["truth"], count["maps"]), (3, 3, 2));
    let again = json(&ask(&longer, &["sweep", "sweep.ron", "--plan", "--json"]));
    assert_eq!(again["distinct_runs"], again["done_before"]);
}

#[test]
fn every_mistake_of_a_sweep_is_told_where_it_stands() {
    let project = Workspace::of("reference.ron");
    project.write(
        "sweep.ron",
        r#"Sweep(graph: "graph.ron",
    axes: [Grid({ "colums": [1, 2], "rows": [(5, 5), (0, 3)] })],
    skip: ["row[0] > 3"],
    measure: ["tensor", "tensor_eror"], cost: ["tensor"], pictures: ["truth"],
    plot: (y: "nothing.at_all", colour: "sun"))"#,
    );
    let checked = ask(&project, &["sweep", "sweep.ron", "--plan", "--json"]);
    assert_eq!(code(&checked), 2, "{}", errors(&checked));
    let told: Vec<String> = json(&checked)["errors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| {
            format!(
                "{}:{}:{} {}",
                e["file"].as_str().unwrap(),
                e["line"],
                e["column"],
                e["message"].as_str().unwrap()
            )
        })
        .collect();
    for expected in [
        "sweep.ron:2:19 there is no variable `colums`",
        "sweep.ron:3:12 there is no variable `row`",
        "sweep.ron:4:15 `tensor` gives Image, no figures",
        "sweep.ron:4:25 the graph has no node `tensor_eror`",
        "sweep.ron:4:70 `truth` gives Image, no picture",
        "sweep.ron:5:15 `nothing.at_all` is no figure of a measured node",
        "sweep.ron:5:41 `sun` is not varied",
    ] {
        assert!(told.iter().any(|t| t == expected), "{expected} in {told:#?}");
    }
    assert!(told.iter().any(|t| t.starts_with("sweep.ron:2:54 ")), "the value (0, 3): {told:#?}");
}

#[test]
fn a_sweep_keeps_within_its_disk() {
    let free = sweep(5, GRID);
    assert_eq!(code(&ask(&free, &["sweep", "sweep.ron", "--json"])), 0);
    let size = |project: &Workspace| {
        let blobs = Store::open(&project.path(".lightloom"), None).unwrap().usage().unwrap();
        blobs.bytes
    };
    let whole = size(&free);
    let bound = sweep(5, &format!("{GRID} limits: (disk: {})", whole as f64 * 0.5e-9));
    let mut command = lightloom(&bound);
    let mut child =
        command.args(["sweep", "sweep.ron", "--json"]).stdout(Stdio::null()).spawn().unwrap();
    let mut most = 0;
    while child.try_wait().unwrap().is_none() {
        if bound.path(".lightloom/v1").exists() {
            most = most.max(size(&bound));
        }
        sleep(Duration::from_millis(5));
    }
    assert!(child.wait().unwrap().success());
    assert!(most < whole * 9 / 10, "{most} bytes of {whole}");
    assert_eq!(figures(&bound.path("out/sweep")), figures(&free.path("out/sweep")));
}

#[test]
fn every_committed_sweep_can_be_planned() {
    let project = Workspace::of("reference.ron");
    let folder = crate::workspace::graphs().join("sweeps");
    let files: Vec<_> = fs::read_dir(folder).unwrap().map(|file| file.unwrap().path()).collect();
    assert!(files.len() >= 5, "{files:?}");
    for file in files {
        let planned = ask(&project, &["sweep", file.to_str().unwrap(), "--plan", "--json"]);
        assert_eq!(code(&planned), 0, "{}: {}", file.display(), errors(&planned));
        let counted = json(&planned);
        assert!(counted["points"].as_u64() >= Some(3), "{}: {counted}", file.display());
        assert!(counted["distinct_runs"].as_u64() < counted["runs_apart"].as_u64());
    }
}
