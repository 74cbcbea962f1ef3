//! Texture lookup: bilinear with wrap, decoded to linear before it is filtered.

use crate::data::Materials;
use glam::Vec2;
use std::sync::LazyLock;

/// Which of a material's textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Texture {
    /// sRGB-encoded colour, linear alpha.
    BaseColour = 0,
    /// Linear; green is roughness, blue is metallic.
    MetallicRoughness = 1,
    /// sRGB-encoded.
    Emission = 2,
}

static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let encoded = i as f64 / 255.0;
        let linear = if encoded <= 0.04045 {
            encoded / 12.92
        } else {
            libm::pow((encoded + 0.055) / 1.055, 2.4)
        };
        linear as f32
    })
});

/// Linear RGBA of texture `which` of material `m` at the coordinates of the surface; ones when the
/// material has no such texture.
pub fn sample(materials: &Materials, m: usize, which: Texture, uv: Vec2) -> [f32; 4] {
    let index = materials.material_texture[m][which as usize];
    if index < 0.0 {
        return [1.0; 4];
    }
    let Some(&[first, width, height]) = materials.texture.get(index as usize) else {
        return [1.0; 4];
    };
    if width == 0 || height == 0 || !uv.is_finite() {
        return [1.0; 4];
    }
    let at = &materials.texture_transform[m][which as usize * 6..];
    let (u, v) = (at[0] * uv.x + at[1] * uv.y + at[2], at[3] * uv.x + at[4] * uv.y + at[5]);
    let (x, y) = (wrap(u) * width as f32 - 0.5, wrap(v) * height as f32 - 0.5);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let (x, y) = (x.floor() as i64, y.floor() as i64);
    let texel = |dx: i64, dy: i64| {
        let column = (x + dx).rem_euclid(i64::from(width)) as usize;
        let row = (y + dy).rem_euclid(i64::from(height)) as usize;
        let stored = materials.texel[first as usize + row * width as usize + column];
        decode(stored, which)
    };
    let corners = [
        (0, 0, (1.0 - fx) * (1.0 - fy)),
        (1, 0, fx * (1.0 - fy)),
        (0, 1, (1.0 - fx) * fy),
        (1, 1, fx * fy),
    ];
    let mut sum = [0.0; 4];
    for (dx, dy, weight) in corners {
        let value = texel(dx, dy);
        (0..4).for_each(|c| sum[c] += value[c] * weight);
    }
    sum
}

fn wrap(coordinate: f32) -> f32 {
    let wrapped = coordinate - coordinate.floor();
    if wrapped.is_finite() { wrapped } else { 0.0 }
}

fn decode(stored: [u8; 4], which: Texture) -> [f32; 4] {
    let linear = |byte: u8| f32::from(byte) / 255.0;
    match which {
        Texture::MetallicRoughness => stored.map(linear),
        Texture::BaseColour | Texture::Emission => {
            let [r, g, b, a] = stored;
            [SRGB[r as usize], SRGB[g as usize], SRGB[b as usize], linear(a)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::plain_materials;

    fn checker() -> Materials {
        let mut materials = plain_materials(&[glam::Vec3::ONE]);
        materials.material_texture = vec![[0.0, -1.0, 0.0]].into();
        materials.texture = vec![[0, 2, 1]].into();
        materials.texel = vec![[0, 0, 0, 255], [255, 188, 0, 0]].into();
        materials
    }

    #[test]
    fn bilinear_in_linear_space_with_wrap() {
        let materials = checker();
        let at = |u: f32| sample(&materials, 0, Texture::BaseColour, Vec2::new(u, 0.5));
        assert_eq!(at(0.25), [0.0, 0.0, 0.0, 1.0]);
        assert!((at(0.75)[1] - 0.5029).abs() < 1e-3);
        assert!((at(0.5)[0] - 0.5).abs() < 1e-6 && (at(1.0)[0] - 0.5).abs() < 1e-6);
        assert_eq!(at(-3.75), at(0.25));
        assert_eq!(at(f32::NAN), [1.0; 4]);
    }

    #[test]
    fn no_texture_is_ones() {
        assert_eq!(sample(&checker(), 0, Texture::MetallicRoughness, Vec2::ZERO), [1.0; 4]);
    }
}
