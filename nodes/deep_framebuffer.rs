//! The deep framebuffer: position, normal and reflectance at every pixel's centre
//! (Hašan et al. 2008, section 5).

use crate::data::{self, Array, Camera, Environment, Geometry, Materials, NONE, Poses};
use crate::kernel::primary::{Lens, Seen, background};
use crate::kernel::receivers::TILE;
use crate::kernel::stage::Stage;
use crate::node::{Ctx, Error, Item, Node, Sizes};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

crate::params! {
    /// What the camera sees at the centre of each pixel: the surface samples that are lit.
    pub struct DeepFramebuffer {
        /// Width and height of the picture in pixels, each at most 16,384.
        size: [u32; 2] = [640, 360];
        /// Smallest perceptual roughness of a seen surface. A sharper lobe than the spacing of the
        /// lights shows every light as a spot; 0 keeps materials as they are.
        min_roughness: f32 = 0.3, 0.0..=1.0;
    }
}

crate::inputs! {
    /// Inputs of [`DeepFramebuffer`].
    pub struct DeepFramebufferIn {
        /// Shapes.
        geometry: Item<Geometry>,
        /// Materials of the shapes.
        materials: Item<Materials>,
        /// Where the shapes are.
        poses: Item<Poses>,
        /// The eye.
        camera: Item<Camera>,
        /// Seen where no surface is; black without it.
        environment: Option<Item<Environment>>,
    }
}

/// What one pixel sees.
#[derive(Clone, Copy)]
struct Sample {
    position: Vec3,
    normal: Vec3,
    facet: Vec3,
    albedo: Vec3,
    specular: Vec3,
    roughness: f32,
    emitted: Vec3,
    triangle: u32,
}

impl Sample {
    /// No surface, and darkness.
    const NOTHING: Sample = Sample {
        position: Vec3::ZERO,
        normal: Vec3::ZERO,
        facet: Vec3::ZERO,
        albedo: Vec3::ZERO,
        specular: Vec3::ZERO,
        roughness: 1.0,
        emitted: Vec3::ZERO,
        triangle: NONE,
    };
}

impl Node for DeepFramebuffer {
    const KIND: &'static str = "DeepFramebuffer";
    const VERSION: u32 = 2;
    type In = DeepFramebufferIn;
    type Out = data::DeepFramebuffer;

    fn check(&self, problems: &mut crate::node::Problems) {
        if self.size.iter().any(|s| !(1..=16_384).contains(s)) {
            problems.report("size", "expected a width and a height from 1 to 16384 pixels");
        }
    }

    fn memory(&self, inputs: &Sizes) -> u64 {
        2 * 92 * u64::from(self.size[0]) * u64::from(self.size[1]) + 8 * inputs.bytes("geometry")
    }

    fn run(&self, input: DeepFramebufferIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let [width, height] = self.size.map(|s| s as usize);
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let lens = Lens::new(&input.camera, width, height);
        let environment = input.environment.as_deref();
        let bands: Vec<Vec<Sample>> = (0..height)
            .into_par_iter()
            .step_by(TILE)
            .map(|top| {
                ctx.tick(top as u64, height as u64)?;
                let rows = top..(top + TILE).min(height);
                let mut band = vec![Sample::NOTHING; rows.len() * width];
                for left in (0..width).step_by(TILE) {
                    let columns = left..(left + TILE).min(width);
                    let pixels: Vec<(usize, usize)> =
                        rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))).collect();
                    let at: Vec<Vec2> = pixels.iter().map(|&(x, y)| Vec2::new(x as f32 + 0.5, y as f32 + 0.5)).collect();
                    lens.see_all(&stage, &at, |i, seen| {
                        let (x, y) = pixels[i];
                        band[(y - top) * width + x] = self.sample(seen, environment);
                    });
                }
                Ok(band)
            })
            .collect::<Result<_, Error>>()?;
        let samples = bands.concat();
        if samples.iter().all(|s| s.triangle == NONE) {
            ctx.note("the camera sees no surface at any pixel");
        }
        Ok(assemble(&samples, [height, width], &input.camera))
    }
}

impl DeepFramebuffer {
    fn sample(&self, seen: Seen, environment: Option<&Environment>) -> Sample {
        match seen {
            Ok((hit, surface)) => Sample {
                position: surface.position,
                normal: surface.normal,
                facet: surface.facet,
                albedo: surface.reflectance.albedo,
                specular: surface.reflectance.specular,
                roughness: surface.reflectance.roughness.max(self.min_roughness),
                emitted: surface.emitted,
                triangle: hit.triangle,
            },
            Err(direction) => {
                let emitted = environment.map_or(Vec3::ZERO, |e| background(e, direction));
                Sample { emitted, ..Sample::NOTHING }
            }
        }
    }
}

fn assemble(samples: &[Sample], shape: [usize; 2], camera: &Camera) -> data::DeepFramebuffer {
    let vectors = |f: fn(&Sample) -> Vec3| Array::shaped(samples.iter().map(f).collect(), &shape);
    data::DeepFramebuffer {
        position: vectors(|s| s.position),
        normal: vectors(|s| s.normal),
        facet: vectors(|s| s.facet),
        albedo: vectors(|s| s.albedo),
        specular: vectors(|s| s.specular),
        roughness: Array::shaped(samples.iter().map(|s| s.roughness).collect(), &shape),
        emitted: vectors(|s| s.emitted),
        triangle: Array::shaped(samples.iter().map(|s| s.triangle).collect(), &shape),
        eye: camera.eye,
        perspective: u8::from(camera.half_height_tangent > 0.0),
        forward: camera.forward,
    }
}
