//! The shapes of a scene, how its instances move, and the shadow bias that its size asks for.

use crate::data::Scene;
use crate::kernel::meshes;
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// The shapes of a scene, the same at all times.
    pub struct Geometry {
        /// Distance by which shadow rays start and end off a surface, as a share of the diagonal of
        /// the bounding box at time 0.
        bias: f32 = 1e-4, 0.0..=0.1;
    }
}

crate::inputs! {
    /// Inputs of [`Geometry`].
    pub struct GeometryIn {
        /// The scene.
        scene: Item<Scene>,
    }
}

impl Node for Geometry {
    const KIND: &'static str = "Geometry";
    const VERSION: u32 = 1;
    type In = GeometryIn;
    type Out = crate::data::Geometry;

    fn run(&self, input: GeometryIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let (geometry, _) = meshes::geometry(&input.scene, self.bias)?;
        if geometry.triangle.is_empty() || geometry.instance.is_empty() {
            ctx.note("the scene has no triangles");
        }
        Ok(geometry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::animation::fixture::{empty, triangle};
    use glam::Vec3;

    #[test]
    fn the_bias_is_stored_in_metres_and_nothing_is_noted() {
        let ctx = Ctx::default();
        let scene = triangle(&[(-1, Vec3::ZERO)]);
        let geometry = Geometry::default().run(GeometryIn { scene: scene.into() }, &ctx).unwrap();
        assert_eq!((geometry.bias, ctx.notes()), (1e-4 * 2_f32.sqrt(), vec![]));
        Geometry::default().run(GeometryIn { scene: empty().into() }, &ctx).unwrap();
        assert_eq!(ctx.notes(), ["the scene has no triangles"]);
    }
}
