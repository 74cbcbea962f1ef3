//! The materials of a scene with their textures.

use crate::data::Scene;
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// The materials of a scene, apart from its shapes: what only shades need not be traced again.
    pub struct Materials {}
}

crate::inputs! {
    /// Inputs of [`Materials`].
    pub struct MaterialsIn {
        /// The scene.
        scene: Item<Scene>,
    }
}

impl Node for Materials {
    const KIND: &'static str = "Materials";
    const VERSION: u32 = 1;
    type In = MaterialsIn;
    type Out = crate::data::Materials;

    fn run(&self, input: MaterialsIn, _: &Ctx) -> Result<Self::Out, Error> {
        let scene = &input.scene;
        let count = scene.base_colour.len();
        let columns = [
            scene.metallic_roughness.len(),
            scene.specular_factor.len(),
            scene.emissive.len(),
            scene.alpha_mode.len(),
            scene.double_sided.len(),
            scene.material_texture.len(),
            scene.texture_transform.len(),
        ];
        if columns != [count; 7] {
            return Err(Error::invalid("the arrays of the scene's materials differ in length"));
        }
        for (i, &[first, width, height]) in scene.texture.iter().enumerate() {
            let texels = u64::from(width) * u64::from(height);
            if texels == 0 || u64::from(first) + texels > scene.texel.len() as u64 {
                return Err(Error::invalid(format!(
                    "texture {i} has no texels, or some that do not exist"
                )));
            }
        }
        let textures = scene.texture.len() as f32;
        if let Some(i) =
            scene.material_texture.iter().position(|m| m.iter().any(|&t| t >= textures))
        {
            return Err(Error::invalid(format!("material {i} has a texture that does not exist")));
        }
        Ok(crate::data::Materials {
            base_colour: scene.base_colour.clone(),
            metallic_roughness: scene.metallic_roughness.clone(),
            specular_factor: scene.specular_factor.clone(),
            emissive: scene.emissive.clone(),
            alpha_mode: scene.alpha_mode.clone(),
            double_sided: scene.double_sided.clone(),
            material_texture: scene.material_texture.clone(),
            texture_transform: scene.texture_transform.clone(),
            texture: scene.texture.clone(),
            texel: scene.texel.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::animation::fixture::triangle;
    use glam::Vec3;

    #[test]
    fn materials_are_passed_on_and_textures_checked() {
        let run = |texture: [u32; 3], first: f32| {
            let mut scene = triangle(&[(-1, Vec3::ZERO)]);
            scene.texture = vec![texture].into();
            scene.texel = vec![[1, 2, 3, 4]; 4].into();
            scene.material_texture = vec![[first, -1.0, -1.0]].into();
            Materials::default().run(MaterialsIn { scene: scene.into() }, &Ctx::default())
        };
        let materials = run([0, 2, 2], 0.0).unwrap();
        assert_eq!(
            (materials.base_colour[0], materials.texel[3]),
            ([0.5, 0.5, 0.5, 1.0], [1, 2, 3, 4])
        );
        assert!(run([1, 2, 2], 0.0).unwrap_err().to_string().contains("texture 0"));
        assert!(run([0, 2, 2], 1.0).unwrap_err().to_string().contains("material 0"));
    }
}
