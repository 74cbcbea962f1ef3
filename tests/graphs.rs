//! The graph files of the repository: each is without mistakes, runs when it is made small, and gives
//! pictures that are finite and not black.

use crate::workspace::{Ran, Workspace, graphs};
use lightloom::nodes::data::{Image, Picture};
use std::fs;

/// Overrides that make a graph small, as far as it has the variables and the nodes.
fn smaller(workspace: &Workspace) -> Vec<String> {
    let graph = workspace.graph(&[]);
    let has = |name: &str| graph.vars.iter().any(|v| v.name == name);
    let vars = [
        ("size", "(64, 36)"),
        ("lights", "256"),
        ("last", "1"),
        ("still", "1"),
        ("surfels", "20000"),
        ("entries", "300"),
    ];
    let mut set: Vec<String> = vars
        .iter()
        .filter(|(name, _)| has(name))
        .map(|(name, value)| format!("{name}={value}"))
        .collect();
    for node in &graph.nodes {
        let fewer = match node.kind {
            "EnvironmentLights" => "count=128",
            "EmissiveLights" => "count=32",
            "GatherSamples" => "count=160",
            "Photons" | "PhotonLights" => "count=500",
            "MergeLights" if !has("lights") => "total=256",
            "Pavilion" | "Meadow" => "detail=0.3",
            _ => continue,
        };
        set.push(format!("{}.{fewer}", node.name));
    }
    set
}

fn finite_and_lit(ran: &Ran, name: &str) {
    let mut images = 0;
    for (n, node) in ran.graph.nodes.iter().enumerate().filter(|(_, node)| node.output == "Image") {
        for item in (0..ran.known.held[n].len()).filter(|&item| ran.known.held[n][item].is_some()) {
            let image: Image = ran.artifact(&node.name, item);
            assert_eq!(image.size(), (64, 36), "{name}: {} {item}", node.name);
            assert!(
                image.radiance.iter().all(|p| p.is_finite()),
                "{name}: {} {item} is not finite",
                node.name
            );
            let sum: f64 = image.radiance.iter().map(|p| f64::from(p.element_sum())).sum();
            assert!(sum > 1.0, "{name}: {} {item} is black, its sum is {sum}", node.name);
            images += 1;
        }
    }
    assert!(images > 0, "{name} makes no image");
}

#[test]
fn every_graph_runs_and_gives_light() {
    let mut files: Vec<_> =
        fs::read_dir(graphs()).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "ron"));
    files.sort();
    assert!(files.len() >= 4, "{files:?}");
    for file in files {
        let name = file.file_name().unwrap().to_str().unwrap();
        let workspace = Workspace::of(name);
        assert_eq!(workspace.graph(&[]).warnings, [], "{name}");
        let set = smaller(&workspace);
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let ran = workspace.run(&set);
        finite_and_lit(&ran, name);
        let published = ran.publish(&workspace.path("out"));
        assert!(
            !published.is_empty()
                && published.iter().all(|p| fs::metadata(&p.path).unwrap().len() > 0),
            "{name}"
        );
        for (output, node) in
            ran.graph.outputs.iter().filter(|(_, node)| ran.graph.nodes[*node].output == "Picture")
        {
            let picture: Picture = ran.artifact(&ran.graph.nodes[*node].name, 0);
            let starts: &[u8] = if &picture.extension[..] == b"png" {
                b"\x89PNG\r\n\x1a\n"
            } else {
                b"\x76\x2f\x31\x01"
            };
            assert!(picture.bytes.starts_with(starts), "{name}: {output} is no picture");
        }
        assert_eq!(workspace.run(&set).nodes(), [""; 0], "{name}");
    }
}
