//! Where every instance of a scene is at one time.

use crate::data::{Scene, Time};
use crate::kernel::posing;
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// Matrices, joint matrices and morph weights of all instances at one time. Those of a static
    /// scene are the same at all times.
    pub struct Poses {}
}

crate::inputs! {
    /// Inputs of [`Poses`].
    pub struct PosesIn {
        /// The scene.
        scene: Item<Scene>,
        /// When; the start of the animation if not given.
        time: Option<Item<Time>>,
    }
}

impl Node for Poses {
    const KIND: &'static str = "Poses";
    const VERSION: u32 = 1;
    type In = PosesIn;
    type Out = crate::data::Poses;

    fn run(&self, input: PosesIn, _: &Ctx) -> Result<Self::Out, Error> {
        posing::poses(&input.scene, input.time.map_or(0.0, |time| time.seconds))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::channel;
    use crate::kernel::animation::fixture::{animate, triangle};
    use glam::Vec3;

    #[test]
    fn instances_are_where_the_time_says() {
        let mut scene = triangle(&[(-1, Vec3::ZERO)]);
        let keys = [1.0, 0.0, 0.0, 3.0, 0.0, 0.0];
        animate(&mut scene, 0, channel::TRANSLATION, channel::LINEAR, &[0.0, 1.0], &keys);
        let scene: Item<Scene> = scene.into();
        let x = |time: Option<f64>| {
            let time = time.map(|seconds| Time { seconds }.into());
            Poses::default()
                .run(PosesIn { scene: scene.clone(), time }, &Ctx::default())
                .unwrap()
                .matrix[0][12]
        };
        assert_eq!((x(None), x(Some(0.5)), x(Some(2.0))), (1.0, 2.0, 3.0));
    }
}
