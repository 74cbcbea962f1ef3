//! Anti-aliasing by a deep framebuffer of higher resolution (Hašan et al. 2008, section 5).

use crate::data::{Camera, DeepFramebuffer, Environment, Geometry, Image, Materials, Poses};
use crate::kernel::neighbours::{Features, nearest_of_3x3};
use crate::kernel::nine_vectors::{nine_vector, nine_vectors};
use crate::kernel::primary::{Lens, background};
use crate::kernel::stage::Stage;
use crate::node::{Ctx, Error, Item, Node, Problems};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

crate::params! {
    /// Looks at the scene in finer steps and gives each fine sample the colour of the pixel, of the 3 x 3
    /// around it, that is most like it; then averages. Shading is not computed again.
    pub struct AntiAlias {
        /// Samples across a pixel; odd, so that the middle one is the pixel's own. 3 in the paper.
        factor: u32 = 3, 1..=15;
        /// Weight of positions, which are counted in scene diagonals.
        position: f32 = 1.0, 0.0..=1000.0;
        /// Weight of unit normals.
        normal: f32 = 0.125, 0.0..=1000.0;
        /// Weight of diffuse reflectances.
        albedo: f32 = 0.125, 0.0..=1000.0;
    }
}

crate::inputs! {
    /// Inputs of [`AntiAlias`].
    pub struct AntiAliasIn {
        /// The picture, one sample a pixel.
        image: Item<Image>,
        /// What it shows.
        framebuffer: Item<DeepFramebuffer>,
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// The eye that took the picture.
        camera: Item<Camera>,
        /// Seen where no surface is.
        environment: Option<Item<Environment>>,
    }
}

impl Node for AntiAlias {
    const KIND: &'static str = "AntiAlias";
    const VERSION: u32 = 1;
    type In = AntiAliasIn;
    type Out = Image;

    fn check(&self, problems: &mut Problems) {
        if self.factor.is_multiple_of(2) {
            problems.report("factor", format!("expected an odd number, found {}", self.factor));
        }
    }

    fn run(&self, input: AntiAliasIn, ctx: &Ctx) -> Result<Image, Error> {
        let (width, height) = input.image.size();
        if input.framebuffer.size() != (width, height) {
            return Err(Error::invalid("the image and the framebuffer have different sizes"));
        }
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let weights = [self.position, self.normal, self.albedo];
        let features = nine_vectors(ctx, &input.framebuffer, &input.geometry, weights)?;
        let lens = Lens::new(&input.camera, width, height);
        let view = View { input: &input, stage: &stage, lens, features, weights };
        let (rows, lost) = (AtomicU64::new(0), AtomicU64::new(0));
        let radiance: Vec<Vec<Vec3>> = (0..height)
            .into_par_iter()
            .map(|y| {
                ctx.tick(rows.fetch_add(1, Ordering::Relaxed), height as u64)?;
                Ok((0..width).map(|x| self.average(&view, x, y, &lost)).collect())
            })
            .collect::<Result<_, Error>>()?;
        let lost = lost.into_inner();
        if lost > 0 {
            ctx.note(format!("{lost} samples see a surface that no pixel around them sees: only its emission is shown"));
        }
        Ok(Image::new(width, height, radiance.concat()))
    }
}

/// What a fine sample is looked up in.
struct View<'a> {
    input: &'a AntiAliasIn,
    stage: &'a Stage,
    lens: Lens<'a>,
    features: Arc<Features>,
    weights: [f32; 3],
}

impl AntiAlias {
    fn average(&self, view: &View<'_>, x: usize, y: usize, lost: &AtomicU64) -> Vec3 {
        let (width, _) = view.input.image.size();
        let own = view.input.image.radiance[y * width + x];
        let middle = self.factor / 2;
        let mut sum = Vec3::ZERO;
        for sy in 0..self.factor {
            for sx in 0..self.factor {
                if (sx, sy) == (middle, middle) {
                    sum += own;
                    continue;
                }
                let offset = Vec2::new(sx as f32 + 0.5, sy as f32 + 0.5) / self.factor as f32;
                sum += view.colour(x, y, Vec2::new(x as f32, y as f32) + offset, lost);
            }
        }
        sum / (self.factor * self.factor) as f32
    }
}

impl View<'_> {
    fn colour(&self, x: usize, y: usize, at: Vec2, lost: &AtomicU64) -> Vec3 {
        let Some((_, surface)) = self.lens.see(self.stage, at) else {
            let (_, direction) = self.lens.ray(at);
            return self.input.environment.as_deref().map_or(Vec3::ZERO, |e| background(e, direction));
        };
        let query = nine_vector(&surface, &self.input.geometry, self.weights);
        match nearest_of_3x3(&self.features, (x as u32, y as u32), &query) {
            Some(pixel) => self.input.image.radiance[pixel as usize],
            None => {
                lost.fetch_add(1, Ordering::Relaxed);
                surface.emitted
            }
        }
    }
}
