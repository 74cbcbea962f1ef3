//! Materials in the metallic-roughness model.

use super::container::Document;
use super::notes::Notes;
use super::textures::Textures;
use crate::data::alpha;
use crate::node::{Ctx, Error};
use glam::Vec3;
use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;

/// The columns of the material table, and what meshes must know of it.
#[derive(Default)]
pub(super) struct Materials {
    pub(super) base_colour: Vec<[f32; 4]>,
    pub(super) metallic_roughness: Vec<[f32; 2]>,
    pub(super) specular_factor: Vec<f32>,
    pub(super) emissive: Vec<Vec3>,
    pub(super) alpha_mode: Vec<[f32; 2]>,
    pub(super) double_sided: Vec<u8>,
    pub(super) texture: Vec<[f32; 3]>,
    pub(super) transform: Vec<[f32; 18]>,
    /// The texture coordinate set that each material uses; none without textures.
    pub(super) uv_set: Vec<Option<u32>>,
}

impl Materials {
    /// Reads all materials of a file and the images they use.
    pub(super) fn read(
        document: &Document,
        textures: &mut Textures<'_>,
        ctx: &Ctx,
        notes: &Notes,
    ) -> Result<Self, Error> {
        let mut materials = Materials::default();
        for (i, material) in document.materials.iter().enumerate() {
            ctx.tick(i as u64, document.materials.len() as u64)?;
            let place = format!("materials[{i}]");
            let named = |e: Error| Error::invalid(format!("{place}: {e}"));
            materials.push(material, textures, notes, &place).map_err(named)?;
        }
        Ok(materials)
    }

    /// Appends glTF's default material.
    pub(super) fn push_default(&mut self) {
        self.base_colour.push([1.0; 4]);
        self.metallic_roughness.push([1.0; 2]);
        self.specular_factor.push(1.0);
        self.emissive.push(Vec3::ZERO);
        self.alpha_mode.push([alpha::OPAQUE, 0.5]);
        self.double_sided.push(0);
        self.texture.push([-1.0; 3]);
        self.transform.push(three([IDENTITY; 3]));
        self.uv_set.push(None);
    }

    fn push(
        &mut self,
        material: &json::Material,
        textures: &mut Textures<'_>,
        notes: &Notes,
        place: &str,
    ) -> Result<(), Error> {
        let pbr = &material.pbr_metallic_roughness;
        let infos =
            [&pbr.base_color_texture, &pbr.metallic_roughness_texture, &material.emissive_texture];
        let sets = infos.map(|info| info.as_ref().map(uv_set));
        let set = sets.into_iter().flatten().next();
        let others = sets.into_iter().flatten().filter(|other| Some(*other) != set).count();
        notes.add(
            "textures on another coordinate set than the first of their material",
            others as u64,
            place,
        );
        let mut rows = [-1.0; 3];
        let mut transforms = [IDENTITY; 3];
        for (slot, info) in infos.into_iter().enumerate() {
            if let Some(info) = info {
                rows[slot] = textures.row(info.index.value())?;
                transforms[slot] = transform(info)?;
            }
        }

        let extensions = material.extensions.as_ref();
        let strength = extensions
            .and_then(|e| e.emissive_strength.as_ref())
            .map_or(1.0, |s| s.emissive_strength.0);
        let emissive = Vec3::from(material.emissive_factor.0) * strength;
        if !emissive.is_finite() || emissive.min_element() < 0.0 {
            return Err(Error::invalid("the emission is negative or not finite"));
        }
        let in_range = |value: f32| {
            if value.is_finite() { Ok(value.clamp(0.0, 1.0)) } else { Err(not_finite()) }
        };
        let base = pbr.base_color_factor.0;
        let specular = extensions.and_then(|e| e.specular.as_ref());
        if let Some(s) = specular
            && (s.specular_texture.is_some()
                || s.specular_color_texture.is_some()
                || s.specular_color_factor.0 != [1.0; 3])
        {
            notes.count("materials with a specular texture or colour, which is ignored", place);
        }
        let specular = specular.map_or(1.0, |s| s.specular_factor.0);
        let factors = [
            base[0],
            base[1],
            base[2],
            base[3],
            pbr.metallic_factor.0,
            pbr.roughness_factor.0,
            specular,
        ];
        let clamped = factors.iter().filter(|v| !(0.0..=1.0).contains(*v)).count();
        notes.add("material factors brought into 0 to 1", clamped as u64, place);

        self.base_colour.push([
            in_range(base[0])?,
            in_range(base[1])?,
            in_range(base[2])?,
            in_range(base[3])?,
        ]);
        self.metallic_roughness.push([in_range(factors[4])?, in_range(factors[5])?]);
        self.specular_factor.push(in_range(specular)?);
        self.emissive.push(emissive);
        self.alpha_mode.push(alpha_mode(material, notes, place)?);
        self.double_sided.push(u8::from(material.double_sided));
        self.texture.push(rows);
        self.transform.push(three(transforms));
        self.uv_set.push(set);
        Ok(())
    }
}

fn not_finite() -> Error {
    Error::invalid("a factor is not finite")
}

fn alpha_mode(material: &json::Material, notes: &Notes, place: &str) -> Result<[f32; 2], Error> {
    let transmission = material.extensions.as_ref().and_then(|e| e.transmission.as_ref());
    if let Some(transmission) = transmission.filter(|t| t.transmission_factor.0 > 0.0) {
        if transmission.transmission_factor.0 > 0.5 && transmission.transmission_texture.is_none() {
            return Ok([alpha::ABSENT, 0.5]);
        }
        notes.count("materials that transmit in part: taken as opaque", place);
    }
    let cutoff = material.alpha_cutoff.map_or(0.5, |c| c.0);
    match material.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => Ok([alpha::OPAQUE, 0.5]),
        Checked::Valid(AlphaMode::Mask) if cutoff.is_finite() => Ok([alpha::MASK, cutoff]),
        Checked::Valid(AlphaMode::Mask) => Err(not_finite()),
        Checked::Valid(AlphaMode::Blend) => {
            notes.count("materials that blend: taken as masks with cutoff 0.5", place);
            Ok([alpha::MASK, 0.5])
        }
        Checked::Invalid => Err(Error::invalid("the alpha mode is unknown")),
    }
}

const IDENTITY: [f32; 6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

fn three([a, b, c]: [[f32; 6]; 3]) -> [f32; 18] {
    std::array::from_fn(|i| [a, b, c][i / 6][i % 6])
}

fn uv_set(info: &json::texture::Info) -> u32 {
    let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
    transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord)
}

/// KHR_texture_transform: scale, then rotation, then offset. Its rotation is counter-clockwise as
/// seen in an image, whose v axis points down; the listing in its text has the other sign, and
/// readers and the Khronos test model agree on this one.
fn transform(info: &json::texture::Info) -> Result<[f32; 6], Error> {
    let Some(t) = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref()) else {
        return Ok(IDENTITY);
    };
    let (sin, cos) = f64::from(t.rotation.0).sin_cos();
    let (sin, cos) = (sin as f32, cos as f32);
    let ([su, sv], [u, v]) = (t.scale.0, t.offset.0);
    let affine = [cos * su, sin * sv, u, -sin * su, cos * sv, v];
    if affine.iter().all(|v| v.is_finite()) {
        Ok(affine)
    } else {
        Err(Error::invalid("a texture transform is not finite"))
    }
}
