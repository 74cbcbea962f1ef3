//! `init`: the graph that a scene requires, with a comment on each choice. What a scene does not
//! need is not in its graph.

use super::Common;
use super::session::{Failure, print_diagnostics};
use crate::graph::Graph;
use crate::registry::Registry;
use lightloom_nodes as nodes;
use nodes::data::{Scene, alpha, instance};
use nodes::kernel::animation::moving;
use nodes::kernel::stage::Stage;
use nodes::node::{Ctx, Error, File, Item, Node};
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::io::Write as _;
use std::path::{Component, Path, PathBuf};

#[derive(clap::Args)]
pub struct Init {
    /// The scene, a .gltf or .glb file.
    scene: PathBuf,
    /// Puts a ground under the scene.
    #[arg(long)]
    ground: bool,
    /// Lights the scene with an .exr or .hdr latitude-longitude map.
    #[arg(long, value_name = "MAP")]
    environment: Option<PathBuf>,
    /// Turns the camera around the scene by this angle.
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = angle)]
    orbit: Option<f32>,
    /// Frames of the shot: 40 by default where something moves, else 1.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Size of the picture, pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = size)]
    size: [u32; 2],
    /// The graph file to write; named after the scene and in the current folder by default.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replaces a file that exists.
    #[arg(long)]
    force: bool,
}

fn angle(text: &str) -> Result<f32, String> {
    let degrees: f32 = text.parse().map_err(|_| "expected degrees")?;
    let turns = degrees != 0.0 && degrees.abs() <= 36_000.0;
    turns.then_some(degrees).ok_or_else(|| "expected degrees from -36000 to 36000, not 0".into())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let number = |text: &str| text.parse().ok().filter(|n| (1..=16_384).contains(n));
    let both = text.split_once('x').and_then(|(w, h)| Some([number(w)?, number(h)?]));
    both.ok_or_else(|| "expected width x height, each 1 to 16384, as in 640x360".into())
}

impl Init {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let out = self.out.clone().unwrap_or_else(|| {
            let mut name = self.scene.file_stem().unwrap_or(self.scene.as_os_str()).to_owned();
            name.push(".ron");
            name.into()
        });
        if !self.force && out.exists() {
            return Err(exists(&out));
        }
        let ctx = Ctx::default();
        let wrong = |e: Error| match e {
            Error::Invalid(what) => Failure::Usage(format!("{}: {what}", self.scene.display())),
            other => Failure::Usage(other.to_string()),
        };
        let scene = nodes::Scene { file: File(self.scene.clone()), clip: 0 }
            .run((), &ctx)
            .map_err(wrong)?;
        let needs = Needs::of(scene, &ctx).map_err(wrong)?;
        if let Some(map) = &self.environment {
            // A map that cannot be read is told now, not by the first run.
            let map = nodes::EnvironmentMap { file: File(map.clone()), ..Default::default() };
            map.run((), &ctx).map_err(|e| Failure::Usage(e.to_string()))?;
        }
        let shot = Shot::new(self, &needs)?;
        let folder = out.parent().unwrap_or(Path::new(""));
        let mut files = vec![quoted(folder, &self.scene)?];
        files.extend(self.environment.as_ref().map(|map| quoted(folder, map)).transpose()?);
        let text = self.graph(&needs, &shot, &files, &out);
        let graph = Graph::read(&text, &out.display().to_string(), folder, registry, &[])
            .map_err(Failure::Graph)?;
        write(&out, &text, self.force)?;
        let (count, frames) = (graph.nodes.len(), shot.frames);
        if common.json {
            let notes = ctx.notes();
            let report = serde_json::json!({ "ok": true, "graph": out, "nodes": count, "frames": frames, "notes": notes });
            println!("{report}");
        } else {
            print_diagnostics(&graph.warnings);
            ctx.notes().iter().for_each(|note| eprintln!("note: {note}"));
            let what = if frames == 1 { "a still".to_owned() } else { format!("{frames} frames") };
            println!("{}: {what}, {count} nodes; `lightloom run {0}` renders it", out.display());
        }
        Ok(())
    }
}

fn exists(out: &Path) -> Failure {
    Failure::Usage(format!(
        "{} exists; --force replaces it, --out FILE writes another",
        out.display()
    ))
}

fn write(out: &Path, text: &str, force: bool) -> Result<(), Failure> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true);
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    let written = options.open(out).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => exists(out),
        _ => Failure::Usage(format!("{}: cannot be written: {e}", out.display())),
    })
}

/// The path of `file` from `folder`, as a string of a graph file: the two can move together.
fn quoted(folder: &Path, file: &Path) -> Result<String, Failure> {
    let wrong =
        |what: &dyn std::fmt::Display| Failure::Usage(format!("{}: {what}", file.display()));
    // An empty path is the current folder, which cannot be made absolute as it is.
    let [from, to] =
        [&Path::new(".").join(folder), file].map(|p| std::path::absolute(p).map(|p| tidy(&p)));
    let path = relative(&from.map_err(|e| wrong(&e))?, &to.map_err(|e| wrong(&e))?);
    let parts: Option<Vec<&str>> = path.iter().map(|part| part.to_str()).collect();
    let text = match (parts, path.has_root()) {
        (Some(parts), false) => parts.join("/"),
        _ => path
            .to_str()
            .ok_or_else(|| wrong(&"its path is not Unicode, as graph files are"))?
            .to_owned(),
    };
    // A string that starts with a dollar sign names a variable.
    Ok(if text.starts_with('$') {
        format!("{:?}", format!("./{text}"))
    } else {
        format!("{text:?}")
    })
}

/// An absolute path without `..`, as its text says.
fn tidy(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut tidied, part| {
        match part {
            Component::ParentDir => drop(tidied.pop()),
            part => tidied.push(part),
        }
        tidied
    })
}

/// The way from one absolute path to another; the other itself when nothing is common to them.
fn relative(from: &Path, to: &Path) -> PathBuf {
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return to.to_owned();
    }
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    up.chain(to.components().skip(common)).collect()
}

/// What a scene has, as far as it decides the graph.
struct Needs {
    /// Cameras, and whether the first moves.
    cameras: (usize, bool),
    /// Point, spot and directional lights that are not black, and whether one moves.
    lights: ([usize; 3], bool),
    /// Emitting triangles at the start, their area in square metres and power in watts.
    emissive: (usize, f64, f64),
    /// Exposure that brings what the strongest lights shine on to about 1; never above 0.
    stops: i32,
    /// End of the animation, seconds.
    seconds: f64,
    /// Instances that move as they are, and those that deform.
    instances: [usize; 2],
    /// Materials in use that are double-sided, and those that have an alpha mask.
    materials: [usize; 2],
    triangles: usize,
    /// Diagonal of the bounding box at the start, metres.
    diagonal: f64,
}

impl Needs {
    fn of(scene: Scene, ctx: &Ctx) -> Result<Needs, Error> {
        let scene: Item<Scene> = scene.into();
        let geometry: Item<_> =
            nodes::Geometry::default().run(nodes::GeometryIn { scene: scene.clone() }, ctx)?.into();
        if geometry.triangle.is_empty() || geometry.instance.is_empty() {
            return Err(Error::invalid("the scene has no triangles, so there is nothing to light"));
        }
        let moving = moving(&scene)?;
        let moves = |node: f32| moving.get(node as usize).copied().unwrap_or(false);
        let lit: Vec<_> = scene.light.iter().filter(|l| l[2..5].iter().any(|c| *c > 0.0)).collect();
        let lights = [0.0, 1.0, 2.0].map(|kind| lit.iter().filter(|l| l[1] == kind).count());
        let motion = |kind| geometry.instance.iter().filter(|i| i[2] == kind).count();
        let used: BTreeSet<u32> = geometry.triangle_material.iter().copied().collect();
        let used_and =
            |has: &dyn Fn(usize) -> bool| used.iter().filter(|m| has(**m as usize)).count();
        let emissive = emission(&scene, &geometry, ctx)?;
        let diagonal = f64::from(geometry.diagonal);
        // Where lights shine on grey from half the diagonal, and emitters on the sphere around all.
        let reach = |l: &[f32; 7]| if l[1] == 2.0 { 1.0 } else { (diagonal / 2.0).powi(2) };
        let near = lit.iter().map(|l| f64::from(l[2] + l[3] + l[4]) / 3.0 / reach(l)).sum::<f64>();
        let radiance = (near + emissive.2 / (PI * diagonal * diagonal)) * 0.5 / PI;
        Ok(Needs {
            cameras: (scene.camera.len(), scene.camera.first().is_some_and(|c| moves(c[0]))),
            lights: (lights, lit.iter().any(|l| moves(l[0]))),
            emissive,
            // Below two stops the guess is worse than none; the limit is that of the pictures.
            stops: if radiance > 4.0 { -(radiance.log2().round().min(64.0) as i32) } else { 0 },
            seconds: scene.key_time.iter().copied().fold(0.0, f32::max).into(),
            instances: [instance::RIGID, instance::DEFORMING].map(motion),
            materials: [
                used_and(&|m| scene.double_sided[m] == 1),
                used_and(&|m| scene.alpha_mode[m][0] == alpha::MASK),
            ],
            triangles: geometry
                .instance
                .iter()
                .map(|i| geometry.mesh[i[0] as usize][1] as usize)
                .sum(),
            diagonal,
        })
    }

    fn shapes_move(&self) -> bool {
        self.instances != [0, 0]
    }

    fn moves(&self) -> bool {
        self.shapes_move() || self.cameras.1 || self.lights.1
    }

    fn punctual(&self) -> usize {
        self.lights.0.iter().sum()
    }
}

/// Emitting triangles, their area and power: as `EmissiveLights` sees them, at their centroids.
fn emission(
    scene: &Item<Scene>,
    geometry: &Item<nodes::data::Geometry>,
    ctx: &Ctx,
) -> Result<(usize, f64, f64), Error> {
    if scene.emissive.iter().all(|e| e.max_element() <= 0.0) {
        return Ok((0, 0.0, 0.0));
    }
    let materials =
        nodes::Materials {}.run(nodes::MaterialsIn { scene: scene.clone() }, ctx)?.into();
    let poses =
        nodes::Poses {}.run(nodes::PosesIn { scene: scene.clone(), time: None }, ctx)?.into();
    let stage = Stage::of(ctx, geometry, &materials, &poses)?;
    let mut sum = (0, 0.0, 0.0);
    for triangle in 0..stage.triangles() {
        let surface = stage.surface(triangle, 1.0 / 3.0, 1.0 / 3.0);
        let area = f64::from(stage.area(triangle)) * if surface.double_sided { 2.0 } else { 1.0 };
        let radiance = f64::from(surface.emitted.element_sum() / 3.0);
        if area * radiance > 0.0 {
            sum = (sum.0 + 1, sum.1 + area, sum.2 + PI * area * radiance);
        }
    }
    Ok(sum)
}

/// The frames to render.
struct Shot {
    frames: u32,
    fps: f64,
    orbit: Option<f32>,
}

impl Shot {
    fn new(init: &Init, needs: &Needs) -> Result<Shot, Failure> {
        let moves = needs.moves() || init.orbit.is_some();
        let frames = init.frames.unwrap_or(if moves { 40 } else { 1 });
        if frames > 1 && !moves {
            let what = format!(
                "--frames {frames}: nothing moves in this scene; --orbit DEGREES turns its camera"
            );
            return Err(Failure::Usage(what));
        }
        if frames == 1 && init.orbit.is_some() {
            return Err(Failure::Usage(
                "--orbit turns the camera over a shot: it needs more than 1 frame".into(),
            ));
        }
        let seconds = if needs.moves() && needs.seconds > 0.0 { needs.seconds } else { 2.0 };
        // Thousandths are what a person would write; the limits are those of `Apng`.
        let fps = ((f64::from(frames) / seconds * 1e3).round() / 1e3).clamp(0.01, 1000.0);
        Ok(Shot { frames, fps, orbit: init.orbit })
    }
}

/// Lights in all, of an environment, and on the sun's disc (Hašan et al. 2008, section 5).
const LIGHTS: [usize; 3] = [65_536, 16_384, 16];

/// The graph of every scene. A line stands in a graph whose scene has all that is named before the
/// bar, nothing with an exclamation mark among it; `<name>` is a value of that scene.
const TEMPLATE: &str = r#"|#![enable(implicit_some)]
|// <name>, as `lightloom init` wrote it: <triangles> triangles, <across> m across.
shot|// A shot by tensor clustering (Hašan et al. 2008).
!shot|// A still by matrix row-column sampling (Hašan et al. 2007).
|// Render it with `lightloom run <out>`; faster: --set size='(160, 90)' --set columns=50
|Graph(
|    // Knobs: used as "$name" below; vary one with --set name=value.
|    vars: {
|        "size": <size>, // pixels
|        // Bins across and down: one row of the lighting matrix in each.
shot|        "rows": (10, 10),
!shot|        "rows": (20, 15),
shot|        "columns": 200, // representatives a frame, on average
!shot|        "columns": 900, // representatives: three for each row
|        "lights": <total>, // at most, those of bounce light included
|        "seed": 1, // of all that is random
shot|        "fps": <fps>, // frames a second
sky|        "sun": (35.0, 60.0), // elevation, and azimuth from +X towards +Z, degrees
|    },
|    nodes: {
shot,moves|        // The frames fill the file's first animation, <seconds> s.
shot,!moves|        // Nothing but the camera moves, for <seconds> s.
shot|        "frames": Frames(first: 0, last: <last>, fps: "$fps"),
shot|
moves|        // `clip: 1` takes the second animation, where the file has one.
|        "<file>": Scene(file: <scene>),
ground|        // A ground just below the lowest point, to catch shadows (--ground).
ground|        "scene": Ground(scene: "file"),
|        "geometry": Geometry(scene: "scene"),
masked|        // Rays pass where alpha is below the cutoff: <masked> materials have an alpha mask.
|        "materials": Materials(scene: "scene"),
posed|        // Without a time, `rest` ties lights to surfaces: light j is the same light in every frame.
posed|        "rest": Poses(scene: "scene"),
posed|        // <rigid> instances move as they are, <deforming> deform.
!posed|        // Without a time: the surfaces stand still.
|        "poses": Poses(scene: "scene"<poses_time>),
subject|        // What the camera looks at: the scene without its ground.
subject|        "subject": Geometry(scene: "file"),
lights_only|        // Only lights move. The camera takes the time all the same: maps and frames need a framebuffer
lights_only|        // for each frame, and equal ones are made once.
camera|        // The first of the file's <cameras> cameras.
camera|        "<own_camera>": Camera(scene: "scene", index: 0<camera_time>),
!camera|        // The file has no camera. This one has all in view; azimuth, elevation and distance move it.
!camera,!orbit|        "camera": OrbitCamera(geometry: "<subject>"<camera_time>, azimuth: 0, elevation: 15, distance: 1),
orbit|        // It turns around the centre; the next frame after the last would complete the angle (--orbit).
orbit,camera|        "camera": OrbitCamera(geometry: "<subject>", time: "frames", base: "own_camera", degrees: <degrees>, seconds: <seconds>),
orbit,!camera|        "camera": OrbitCamera(geometry: "<subject>", time: "frames", degrees: <degrees>, seconds: <seconds>, azimuth: 0, elevation: 15, distance: 1),
|
punctual|        // The file's own lights: <points> points, <spots> spots, <directional> directional.
punctual|        "punctual": PunctualLights(scene: "scene"<lights_time>),
sky|        // The scene has no light of its own: a clear sky and its sun, so that there is something to
sky|        // see. `lightloom init --environment MAP` takes another sky.
sky|        "environment": Sky(sun: "$sun"),
sky|        "sun": SunLights(sun: "$sun"),
map|        // Light from all around (--environment); `rotation` turns it, `scale` dims it.
map|        "environment": EnvironmentMap(file: <map>, rotation: 0, scale: 1),
around|        "environment_lights": EnvironmentLights(environment: "environment", count: <around>, seed: "$seed"),
emissive|        // <emissive> triangles emit: <area> square metres, <power> W. Large emitters are close to much of
emissive|        // what they light, and ask for more lights.
emissive|        "emissive": EmissiveLights(<at><emissive_rest>, count: <emitters>, seed: "$seed"),
|
|        // Bounce light: samples on all surfaces gather light and become lights. They ask each light of
|        // the few; what the many send comes by photons.
around,emissive|        "many": MergeLights(lights: ["environment_lights", "emissive"]),
|        "photons": Photons(<at><direct><many>, seed: "$seed"),
two_sided|        // Both sides reflect: <two_sided> materials are double-sided. With the others these are all lights.
!two_sided|        // Only fronts reflect: no material is double-sided. With the others these are all lights.
|        "samples": GatherSamples(geometry: "geometry", materials: "materials", rest: "<rest>", count: <samples>, sides: <sides>, seed: "$seed"),
|        "bounce": GatherLights(samples: "samples", <at><direct>, photons: "photons"),
|        "lights": MergeLights(lights: <all>, total: "$lights"),
|
|        // What the camera sees, and a few rows of the lighting matrix.
|        "framebuffer": DeepFramebuffer(<at>, camera: "camera"<background>, size: "$size"),
|        "rows": Rows(framebuffer: "framebuffer", lights: "lights", <at>, bins: "$rows"),
|
shot|        // Clusters over lights and time; a column is mapped from its frame to the frames that it serves.
shot|        "maps": PixelMaps(framebuffer: "framebuffer", geometry: "geometry"),
shot|        "clusters": Clusters(rows: "rows", maps: "maps", seed: "$seed"),
!shot|        // Clusters of lights: this is a single frame.
!shot|        "clusters": ColumnClusters(rows: "rows", count: "$columns", seed: "$seed"),
|        // The brightest light stands for its cluster, scaled in each colour.
|        "representatives": Representatives(clusters: "clusters", rows: "rows", count: "$columns", choose: max, scale: rgb),
|        "image": Reconstruct(representatives: "representatives", framebuffer: "framebuffer", lights: "lights", <at><maps>),
|        "smooth": AntiAlias(image: "image", framebuffer: "framebuffer", <at>, camera: "camera"<background>),
|
|        // To measure the error, uncomment these two and the output below; adding up all lights takes long.
|        // "reference": Reference(framebuffer: "framebuffer", lights: "lights", <at>),
|        // "compare": Compare(image: "image", reference: "reference"),
|
|        // Radiance as it is, and something to look at; an exposure of 1 makes it twice as bright.
bright|        // The lights are strong: the exposure is a guess from their distance and power.
sky|        // In the sun, one stop less.
|        "exr": Exr(image: "smooth", precision: half),
shot|        "preview": Apng(images: "smooth", fps: "$fps", exposure: <exposure>),
!shot|        "png": Png(image: "smooth", exposure: <exposure>),
|    },
|    outputs: {
|        "frame": "exr",
shot|        "preview": "preview",
!shot|        "picture": "png",
|        // "error": "compare",
|    },
|)
"#;

impl Init {
    /// The text of the graph; `files` are the scene and the map as they stand in it.
    fn graph(&self, n: &Needs, shot: &Shot, files: &[String], out: &Path) -> String {
        let moving = shot.frames > 1;
        let (posed, punctual) = (moving && n.shapes_move(), n.punctual() > 0);
        let (map, emissive) = (files.len() > 1, n.emissive.0 > 0);
        let sky = !(map || punctual || emissive);
        let (around, own) = (map || sky, n.cameras.0 > 0);
        let lights_only = moving && !(posed || n.cameras.1 || shot.orbit.is_some());
        let subject = self.ground && (!own || shot.orbit.is_some());
        let has = [
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
            () if n.emissive.1 < 0.01 * n.diagonal * n.diagonal => 4096,
            () => 8192,
        };
        let few = if punctual { "punctual" } else { "sun" };
        let mut all = Vec::new();
        for (name, is) in
            [(few, punctual || sky), ("environment_lights", around), ("emissive", emissive)]
        {
            all.extend(is.then_some(name));
        }
        let many =
            if around && emissive { "many" } else { all.last().copied().unwrap_or_default() };
        all.push("bounce");
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
            ("around", LIGHTS[1].to_string()),
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

/// The lines of the template that hold, with their values.
fn fill(has: &[(&str, bool)], values: &[(&str, String)]) -> String {
    let holds = |word: &str| has.contains(&(word.trim_start_matches('!'), !word.starts_with('!')));
    let value = |name| values.iter().find(|(n, _)| *n == name).map_or("", |(_, value)| value);
    let mut text = String::new();
    for line in TEMPLATE.lines() {
        let Some((words, line)) = line.split_once('|') else { continue };
        if !words.split(',').all(|word| word.is_empty() || holds(word)) {
            continue;
        }
        for (i, part) in line.split('<').enumerate() {
            match part.split_once('>') {
                Some((name, rest)) if i > 0 => text.extend([value(name), rest]),
                _ => text.push_str(part),
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const TRIANGLE: &str = r#"{ "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [ { "type": "point", "intensity": 9000 } ] } },
        "buffers": [{ "byteLength": 36, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] }],
        "materials": [{ "doubleSided": true, "emissiveFactor": [1, 0, 0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "nodes": [{ "mesh": 0 }, { "extensions": { "KHR_lights_punctual": { "light": 0 } } }],
        "scenes": [{ "nodes": [0, 1] }], "scene": 0 }"#;

    fn init(scene: &Path) -> Init {
        let (environment, orbit, frames, out) = (None, None, None, None);
        Init {
            scene: scene.into(),
            ground: false,
            environment,
            orbit,
            frames,
            size: [64, 36],
            out,
            force: false,
        }
    }

    fn dull() -> Needs {
        Needs {
            cameras: (0, false),
            lights: ([0; 3], false),
            emissive: (0, 0.0, 0.0),
            stops: 0,
            seconds: 0.0,
            instances: [0; 2],
            materials: [0; 2],
            triangles: 1,
            diagonal: 1.0,
        }
    }

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
        for bits in 0..1 << 9 {
            let on = |bit: u32| bits >> bit & 1 == 1;
            let mut init = init(Path::new("a<b>|{c}.glb"));
            let mut needs = dull();
            init.ground = on(0);
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
            assert_eq!(
                (is("Frames"), is("PixelMaps"), is("Apng")),
                (moving, moving, moving),
                "{bits:b}"
            );
            assert_eq!(
                (is("ColumnClusters"), is("Png"), is("Clusters")),
                (!moving, !moving, moving)
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

    #[test]
    fn a_file_becomes_a_graph_once() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("triangle.gltf");
        fs::write(&scene, TRIANGLE).unwrap();
        let common = Common { json: true, cache: folder.path().into(), quota: 1.0 };
        let run = |init: &Init| match init.run(&common, &Registry::builtin()) {
            Ok(()) => String::new(),
            Err(Failure::Usage(what)) => what,
            Err(_) => panic!("not a mistake of usage"),
        };
        let out = folder.path().join("graphs/made.ron");
        let mut init = init(&scene);
        init.out = Some(out.clone());
        assert!(run(&init).contains("cannot be written"));
        fs::create_dir(folder.path().join("graphs")).unwrap();
        assert_eq!(run(&init), "");
        let text = fs::read_to_string(&out).unwrap();
        assert!(text.contains("Scene(file: \"../triangle.gltf\")"), "{text}");
        assert!(
            text.contains("1 points") && text.contains("1 triangles emit: 1.0000 square metres"),
            "{text}"
        );
        assert!(text.contains("sides: both") && text.contains("exposure: -11"), "{text}");
        assert!(run(&init).contains("--force"));
        init.force = true;
        assert_eq!(run(&init), "");
        init.frames = Some(2);
        assert!(run(&init).contains("nothing moves"));
        init.frames = None;
        init.environment = Some("nowhere.hdr".into());
        assert!(run(&init).contains("nowhere.hdr"));
        init.scene = "nowhere.glb".into();
        assert!(run(&init).contains("nowhere.glb"));
        assert_eq!(fs::read_to_string(&out).unwrap(), text);
    }

    #[test]
    fn a_shot_fills_the_animation() {
        let mut needs = dull();
        needs.instances = [0, 1];
        needs.seconds = 3.416_67;
        let Ok(shot) = Shot::new(&init(Path::new("a.glb")), &needs) else { panic!("no shot") };
        assert_eq!((shot.frames, shot.fps), (40, 11.707));
        needs.seconds = 1e-5;
        assert!(Shot::new(&init(Path::new("a.glb")), &needs).is_ok_and(|shot| shot.fps == 1000.0));
    }

    #[test]
    fn paths_start_at_the_graph() {
        let from = |folder: &str, file: &str| {
            quoted(Path::new(folder), Path::new(file)).unwrap_or_default()
        };
        assert_eq!(from("", "a/../b.glb"), "\"b.glb\"");
        assert_eq!(from("graphs/x", "scenes/b \"1\".glb"), "\"../../scenes/b \\\"1\\\".glb\"");
        assert_eq!(from("", "$b.glb"), "\"./$b.glb\"");
        assert_eq!(relative(Path::new("/a/b"), Path::new("/a/c/d")), Path::new("../c/d"));
    }

    #[test]
    fn sizes_and_angles() {
        assert_eq!((size("640x360"), angle("-90")), (Ok([640, 360]), Ok(-90.0)));
        assert!(["640", "0x1", "1x16385", "1x1x1"].iter().all(|text| size(text).is_err()));
        assert!(["0", "NaN", "inf", "1e9", "x"].iter().all(|text| angle(text).is_err()));
    }
}
