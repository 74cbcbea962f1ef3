//! What a scene's graph takes of the template, and the values that it fills in.

use super::Init;
use super::needs::Needs;
use super::shot::Shot;
use super::template::fill;
use std::path::Path;

/// Lights of an environment and of emissive surfaces where bounces go by points: they are summed for each point and pixel.
const BY_POINTS: [usize; 2] = [256, 512];
/// Lights in all, of an environment, and on the sun's disc (Hašan et al. 2008, section 5).
const LIGHTS: [usize; 3] = [65_536, 16_384, 16];

impl Init {
    /// The text of the graph; `files` are the scene and the map as they stand in it.
    pub(super) fn graph(&self, n: &Needs, shot: &Shot, files: &[String], out: &Path) -> String {
        let moving = shot.frames > 1;
        let (posed, punctual) = (moving && n.shapes_move(), n.punctual() > 0);
        let (map, emissive) = (files.len() > 1, n.emissive.0 > 0);
        let sky = !(map || punctual || emissive);
        let (around, own) = (map || sky, n.cameras.0 > 0);
        let lights_only = moving && !(posed || n.cameras.1 || shot.orbit.is_some());
        let subject = self.ground && (!own || shot.orbit.is_some());
        let few = if punctual { "punctual" } else { "sun" };
        let lamps: Vec<&str> = [(few, punctual || sky), ("emissive", emissive)]
            .into_iter()
            .filter_map(|(name, is)| is.then_some(name))
            .collect();
        let has = [
            ("points", self.points),
            ("lamps", !lamps.is_empty()),
            ("shot", moving),
            ("moves", n.moves()),
            ("posed", posed),
            ("ground", self.ground),
            ("masked", n.materials[1] > 0),
            ("two_sided", n.materials[0] > 0),
            ("subject", subject),
            ("lights_only", lights_only),
            ("camera", own),
            ("orbit", shot.orbit.is_some()),
            ("punctual", punctual),
            ("sky", sky),
            ("map", map),
            ("around", around),
            ("emissive", emissive),
            ("bright", n.stops < 0 && !map),
        ];
        let emitters = match () {
            () if !emissive => 0,
            () if self.points => BY_POINTS[1],
            () if n.emissive.1 < 0.01 * n.diagonal * n.diagonal => 4096,
            () => 8192,
        };
        let mut all = Vec::new();
        for (name, is) in
            [(few, punctual || sky), ("environment_lights", around), ("emissive", emissive)]
        {
            all.extend(is.then_some(name));
        }
        let many =
            if around && emissive { "many" } else { all.last().copied().unwrap_or_default() };
        if !self.points {
            all.push("bounce");
        }
        let others = n.punctual()
            + emitters
            + if sky { LIGHTS[2] } else { 0 }
            + if around { LIGHTS[1] } else { 0 };
        let port = |is: bool, name: &str, to: &str| {
            if is { format!(", {name}: {to:?}") } else { String::new() }
        };
        let time = |moves: bool| port(moving && moves, "time", "frames");
        let values = [
            ("name", file_name(&self.scene)),
            ("out", file_name(out)),
            ("triangles", n.triangles.to_string()),
            ("across", format!("{:.4}", n.diagonal)),
            ("size", format!("({}, {})", self.size[0], self.size[1])),
            ("total", LIGHTS[0].to_string()),
            ("fps", shot.fps.to_string()),
            ("last", (shot.frames - 1).to_string()),
            ("seconds", format!("{:.4}", f64::from(shot.frames) / shot.fps)),
            (
                "exposure",
                if sky {
                    -1
                } else if map {
                    0
                } else {
                    n.stops
                }
                .to_string(),
            ),
            ("degrees", shot.orbit.unwrap_or_default().to_string()),
            ("file", if self.ground { "file" } else { "scene" }.into()),
            ("scene", files[0].clone()),
            ("map", files.last().cloned().unwrap_or_default()),
            ("masked", n.materials[1].to_string()),
            ("two_sided", n.materials[0].to_string()),
            ("sides", if n.materials[0] > 0 { "both" } else { "front" }.into()),
            ("rigid", n.instances[0].to_string()),
            ("deforming", n.instances[1].to_string()),
            ("cameras", n.cameras.0.to_string()),
            ("own_camera", if shot.orbit.is_some() { "own_camera" } else { "camera" }.into()),
            ("subject", if subject { "subject" } else { "geometry" }.into()),
            ("poses_time", time(posed)),
            ("camera_time", time(n.cameras.1 || lights_only)),
            ("lights_time", time(n.lights.1)),
            ("points", n.lights.0[0].to_string()),
            ("spots", n.lights.0[1].to_string()),
            ("directional", n.lights.0[2].to_string()),
            ("around", if self.points { BY_POINTS[0] } else { LIGHTS[1] }.to_string()),
            ("lamps", format!("{lamps:?}")),
            ("lamps_port", port(!lamps.is_empty(), "lights", "lamps")),
            ("emissive", n.emissive.0.to_string()),
            ("area", format!("{:.4}", n.emissive.1)),
            ("power", format!("{:.4}", n.emissive.2)),
            ("emitters", emitters.to_string()),
            ("at", r#"geometry: "geometry", materials: "materials", poses: "poses""#.into()),
            ("rest", if posed { "rest" } else { "poses" }.into()),
            ("emissive_rest", port(posed, "rest", "rest")),
            ("direct", port(punctual || sky, "direct", few)),
            ("many", port(around || emissive, "area", many)),
            ("samples", LIGHTS[0].saturating_sub(others).max(1024).to_string()),
            ("all", format!("{all:?}")),
            ("background", port(around, "environment", "environment")),
            ("maps", port(moving, "maps", "maps")),
        ];
        fill(&has, &values)
    }
}

/// A file's name, for comments: on one line whatever it is.
fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    name.to_string_lossy().escape_debug().to_string()
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{dull, init};
    use super::*;
    use crate::graph::Graph;
    use crate::registry::Registry;
    use std::collections::BTreeSet;

    fn read(text: &str) -> Graph {
        let graph = Graph::read(text, "test.ron", Path::new(""), &Registry::builtin(), &[]);
        let show = |all: Vec<crate::graph::Diagnostic>| {
            all.iter().map(|d| d.render(false)).collect::<String>()
        };
        let mut graph = graph.unwrap_or_else(|mistakes| panic!("{}\n{text}", show(mistakes)));
        assert!(graph.warnings.is_empty(), "{}", show(std::mem::take(&mut graph.warnings)));
        graph
    }

    fn kinds(graph: &Graph) -> BTreeSet<&'static str> {
        graph.nodes.iter().map(|n| n.kind).collect()
    }

    /// Every combination of what a scene may have gives a graph without mistakes or idle nodes.
    #[test]
    fn every_graph_is_whole() {
        for bits in 0..1 << 10 {
            let on = |bit: u32| bits >> bit & 1 == 1;
            let mut init = init(Path::new("a<b>|{c}.glb"));
            let mut needs = dull();
            init.ground = on(0);
            init.points = on(9);
            init.environment = on(1).then(|| "sky.hdr".into());
            init.orbit = on(2).then_some(-90.0);
            needs.cameras = (usize::from(on(3)), on(3) && on(8));
            needs.lights = ([usize::from(on(4)); 3], on(4) && on(8));
            needs.emissive = if on(5) { (2, 1.0, 9.0) } else { (0, 0.0, 0.0) };
            needs.instances = [usize::from(on(6)); 2];
            needs.materials = [usize::from(on(7)); 2];
            needs.seconds = 1.7;
            let Ok(shot) = Shot::new(&init, &needs) else { panic!("{bits:b} has no shot") };
            let files: Vec<String> = [Some(&init.scene), init.environment.as_ref()]
                .into_iter()
                .flatten()
                .map(|f| format!("{f:?}"))
                .collect();
            let text = init.graph(&needs, &shot, &files, Path::new("test.ron"));
            let graph = read(&text);
            let outputs: Vec<usize> = graph.outputs.iter().map(|(_, node)| *node).collect();
            let idle = graph
                .needed(&outputs)
                .iter()
                .position(|needed| !needed)
                .map(|k| &graph.nodes[k].name);
            assert_eq!(idle, None, "{bits:b}\n{text}");
            let kinds = kinds(&graph);
            let is = |kind: &str| kinds.contains(kind);
            let sky = !(on(1) || on(4) || on(5));
            assert_eq!((is("Sky"), is("SunLights"), is("EnvironmentMap")), (sky, sky, on(1)));
            assert_eq!(
                (is("PunctualLights"), is("EmissiveLights"), is("Ground")),
                (on(4), on(5), on(0))
            );
            assert_eq!((is("Camera"), is("OrbitCamera")), (on(3), on(2) || !on(3)));
            let moving = on(2) || on(6) || on(8) && (on(3) || on(4));
            let matrix = !on(9);
            assert_eq!(
                (is("Frames"), is("PixelMaps"), is("Apng"), is("Png")),
                (moving, moving && matrix, moving, !moving),
                "{bits:b}"
            );
            assert_eq!(
                (is("ColumnClusters"), is("Clusters"), is("PbgiGather"), is("Photons")),
                (!moving && matrix, moving && matrix, on(9), matrix)
            );
            let poses = graph.nodes.iter().filter(|n| n.kind == "Poses").count();
            assert_eq!(poses, 1 + usize::from(on(6)));
            assert!(graph.find("file").is_none() || on(0));
        }
    }

    #[test]
    fn the_error_can_be_uncommented() {
        let init = init(Path::new("a.glb"));
        let Ok(shot) = Shot::new(&init, &dull()) else { panic!("no shot") };
        let text = init.graph(&dull(), &shot, &["\"a.glb\"".into()], Path::new("a.ron"));
        let kinds = kinds(&read(&text.replace("// \"", "\"")));
        assert!(kinds.contains("Reference") && kinds.contains("Compare"));
    }
}
