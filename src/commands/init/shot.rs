//! The frames that a graph renders.

use super::Init;
use super::needs::Needs;
use crate::commands::session::Failure;

/// The frames to render.
pub(super) struct Shot {
    pub(super) frames: u32,
    pub(super) fps: f64,
    pub(super) orbit: Option<f32>,
}

impl Shot {
    pub(super) fn new(init: &Init, needs: &Needs) -> Result<Shot, Failure> {
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

#[cfg(test)]
mod tests {
    use super::super::fixtures::{dull, init};
    use super::*;
    use std::path::Path;

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
}
