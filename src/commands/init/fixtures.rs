//! What the tests of this command share: its arguments, and a scene with next to nothing in it.

use super::Init;
use super::needs::Needs;
use std::path::Path;

/// The arguments of which only the scene is given.
pub fn init(scene: &Path) -> Init {
    let (environment, orbit, frames, out) = (None, None, None, None);
    Init {
        scene: scene.into(),
        ground: false,
        points: false,
        environment,
        orbit,
        frames,
        size: [64, 36],
        out,
        force: false,
    }
}

/// A single triangle: no light, no camera, nothing that moves.
pub fn dull() -> Needs {
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
