//! The graph of every scene as one text, of which each scene takes its lines.

/// The graph of every scene. A line stands in a graph whose scene has all that is named before the
/// bar, nothing with an exclamation mark among it; `<name>` is a value of that scene.
pub const TEMPLATE: &str = r#"|#![enable(implicit_some)]
|// <name>, as `lightloom init` wrote it: <triangles> triangles, <across> m across.
shot,!points|// A shot by tensor clustering (Hašan et al. 2008).
!shot,!points|// A still by matrix row-column sampling (Hašan et al. 2007).
points|// One bounce of light between points (Christensen 2008; Buchholz and Boubekeur 2012).
!points|// Render it with `lightloom run <out>`; faster: --set size='(160, 90)' --set columns=50
points|// Render it with `lightloom run <out>`; faster: --set size='(160, 90)' --set surfels=100000
|Graph(
|    // Knobs: used as "$name" below; vary one with --set name=value.
|    vars: {
|        "size": <size>, // pixels
!points|        // Bins across and down: one row of the lighting matrix in each.
shot,!points|        "rows": (10, 10),
!shot,!points|        "rows": (20, 15),
shot,!points|        "columns": 200, // representatives a frame, on average
!shot,!points|        "columns": 1000, // representatives
!points|        "lights": <total>, // at most, those of bounce light included
points|        "surfels": 400000, // points on all surfaces
points|        "resolution": 8, // cells a side of each pixel's buffer
points|        "factor": 2.0, // solid angle below which a node of their tree is not opened, in cells
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
lights_only|        // Only lights move. The camera takes the time all the same: frames need a framebuffer each, and
lights_only|        // equal ones are made once.
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
!points|        // Bounce light: samples on all surfaces gather light and become lights. They ask each light of
!points|        // the few; what the many send comes by photons.
!points,around,emissive|        "many": MergeLights(lights: ["environment_lights", "emissive"]),
shot,!points|        "photons": Photons(<at><direct><many>, count: 30000, seed: "$seed"),
!shot,!points|        "photons": Photons(<at><direct><many>, count: 100000, seed: "$seed"),
two_sided,!points|        // Both sides reflect: <two_sided> materials are double-sided. With the others these are all lights.
!two_sided,!points|        // Only fronts reflect: no material is double-sided. With the others these are all lights.
!points|        "samples": GatherSamples(geometry: "geometry", materials: "materials", rest: "<rest>", count: <samples>, sides: <sides>, seed: "$seed"),
!points|        "bounce": GatherLights(samples: "samples", <at><direct>, photons: "photons"),
!points|        "lights": MergeLights(lights: <all>, total: "$lights"),
points|        // What points are lit by; pixels see the sky itself between them.
points|        "lights": MergeLights(lights: <all>),
points,lamps|        "lamps": MergeLights(lights: <lamps>),
|
points|        // Points on all surfaces, on both sides of open ones whose material is double-sided, and their tree.
points|        "surfels": Surfels(geometry: "geometry", materials: "materials", rest: "<rest>", count: "$surfels", seed: "$seed"),
points|        "lit": ShadeSurfels(surfels: "surfels", <at>, lights: "lights"),
points|        "tree": PbgiTree(surfels: "lit"),
|
points|        // What the camera sees, and the light on it.
!points|        // What the camera sees, and a few rows of the lighting matrix.
|        "framebuffer": DeepFramebuffer(<at>, camera: "camera"<background>, size: "$size"),
!points|        "rows": Rows(framebuffer: "framebuffer", lights: "lights", <at>, bins: "$rows"),
|
shot,!points|        // Clusters over lights and time; a column is mapped from its frame to the frames that it serves.
shot,!points|        "maps": PixelMaps(framebuffer: "framebuffer", geometry: "geometry"),
shot,!points|        "clusters": Clusters(rows: "rows", maps: "maps", seed: "$seed"),
!shot,!points|        // Clusters of lights: this is a single frame.
!shot,!points|        "clusters": ColumnClusters(rows: "rows", count: "$columns", seed: "$seed"),
!points|        // The light most like the sum of its cluster stands for it, scaled in each colour.
shot,!points|        "representatives": Representatives(clusters: "clusters", rows: "rows", count: "$columns", choose: medoid),
!shot,!points|        // All together are then made to fit what the rows know.
!shot,!points|        "representatives": Representatives(clusters: "clusters", rows: "rows", count: "$columns", choose: medoid, fit: rows),
points,lamps|        // Lamps one by one; the sky and what surfaces reflect by the points.
points,!lamps|        // Without lamps: what is seen of the sky. The rest comes by the points.
points|        "direct": Reference(framebuffer: "framebuffer"<lamps_port>, <at>),
points|        "indirect": PbgiGather(tree: "tree", framebuffer: "framebuffer"<background>, resolution: "$resolution", factor: "$factor"),
points|        "image": Sum(images: ["direct", "indirect"]),
!points|        "image": Reconstruct(representatives: "representatives", framebuffer: "framebuffer", lights: "lights", <at><maps>),
|        "smooth": AntiAlias(image: "image", framebuffer: "framebuffer", <at>, camera: "camera"<background>),
|
!points|        // To measure the error, uncomment these two and the output below; adding up all lights takes long.
!points|        // "reference": Reference(framebuffer: "framebuffer", lights: "lights", <at>),
!points|        // "compare": Compare(image: "image", reference: "reference"),
!points|
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
!points|        // "error": "compare",
|    },
|)
"#;

/// The lines of the template that hold, with their values.
pub fn fill(has: &[(&str, bool)], values: &[(&str, String)]) -> String {
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
