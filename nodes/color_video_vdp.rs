//! ColorVideoVDP: how good a shot looks beside its reference (Mantiuk et al. 2024), by the crate
//! `colorvideovdp`.

use crate::data::{ColorVideoVdp as Quality, Image};
use crate::kernel::metrics::{Pair, count};
use crate::node::{All, Ctx, Error, Node, ParamValue, Sizes};
use colorvideovdp::{Color, Cvvdp, DisplayModel, Image as Frame, Options, Photometry};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

crate::choice! {
    /// A display, its room and the viewer's distance, by the model's own name.
    pub enum VdpDisplay {
        /// 30 inches, 3840x2160, 200 cd/m2, in an office, seen from 0.75 m.
        Standard4k = "standard_4k",
        /// 24 inches, 1920x1080, 200 cd/m2, in an office, seen from 0.6 m.
        StandardFhd = "standard_fhd",
        /// A telephone: 6 inches, 2400x1080, 500 cd/m2, in an office, seen from 0.4 m.
        StandardPhone = "standard_phone",
        /// A headset: 110 degrees, 1440x1600 for each eye, 100 cd/m2.
        StandardHmd = "standard_hmd",
        /// 30 inches, 3840x2160, 1500 cd/m2, in dim light, seen from 0.75 m.
        StandardHdrLinear = "standard_hdr_linear",
        /// The same in the dark.
        StandardHdrLinearDark = "standard_hdr_linear_dark",
        /// 30 inches, 3840x2160, 10000 cd/m2, in dim light, seen from 0.25 m.
        StandardHdrLinearZoom = "standard_hdr_linear_zoom",
    }
}

crate::params! {
    /// How good a shot, or a single image, looks beside its reference: ColorVideoVDP (Mantiuk et al.
    /// 2024, model 0.5.7), which knows colour, contrast, masking and flicker. 10 JOD is no visible
    /// difference; of two shots that are 1 JOD apart three of four viewers choose the better one.
    /// Radiance of 1, raised by the exposure, is the display's white; above is white, negative is
    /// black; the display adds its own black and the light it reflects. A pixel of the image is a
    /// pixel of the display. The model compares contrasts, each with its own surroundings: a picture
    /// that is darker by one factor everywhere is as good as its reference, as far as the display's
    /// black lets it be.
    pub struct ColorVideoVdp {
        /// Frames per second; a single image has none.
        fps: f32 = 20.0, 0.01..=1000.0;
        /// The display, its room and the viewer's distance.
        display: VdpDisplay = VdpDisplay::Standard4k;
        /// Stops by which the radiance is raised first: 1 doubles it. An HDR display's white is far
        /// above that of paper: -3 makes radiance 1 of 1500 cd/m2 about 190.
        exposure: f32 = 0.0, -64.0..=64.0;
    }
}

crate::inputs! {
    /// Inputs of [`ColorVideoVdp`].
    pub struct ColorVideoVdpIn {
        /// What to judge; all of one size, at least 4x4 pixels, and finite.
        image: All<Image>,
        /// What it should be: as many images, of the same size.
        reference: All<Image>,
    }
}

impl Node for ColorVideoVdp {
    const KIND: &'static str = "ColorVideoVdp";
    const VERSION: u32 = 1;
    type In = ColorVideoVdpIn;
    type Out = Quality;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // All frames as the display shows them; then planes of one number a pixel, a third of an
        // image: the crate's bound of 96, and six for each frame that its temporal filters still need.
        let frames = inputs.items("image").max(1);
        let history = (u64::from((self.fps / 8.0).ceil() as u32) * 2 + 1).min(frames);
        let image = inputs.bytes("image") / frames;
        2 * frames * image + (96 + 6 * history) * image / 3 + (4 << 20)
    }

    fn run(&self, input: ColorVideoVdpIn, ctx: &Ctx) -> Result<Quality, Error> {
        let count = count(&input.image, &input.reference)?;
        let name = self.display.show();
        let display = DisplayModel::from_name(&name).map_err(failed)?;
        let photometry = display.photometry.clone();
        // What it needs is what this node states; the crate's own limit of 1 GiB knows no scheduler.
        let metric = Cvvdp::new(display, Options::default().with_memory_limit_bytes(usize::MAX))
            .map_err(failed)?;
        let (mut images, mut references) = (Vec::new(), Vec::new());
        let mut first = None;
        for k in 0..count {
            ctx.tick(k as u64, 2 * count as u64)?;
            let pair = Pair::get(&input.image, &input.reference, k)?;
            let size = pair.size();
            let (width, height) = *first.get_or_insert(size);
            if size != (width, height) {
                return Err(Error::invalid(format!(
                    "image {k} is {}x{} pixels but image 0 is {width}x{height}",
                    size.0, size.1
                )));
            }
            if width < 4 || height < 4 {
                return Err(Error::invalid(format!(
                    "image 0 is {width}x{height} pixels: ColorVideoVDP needs 4x4 or more"
                )));
            }
            images.push(self.frame(&pair.image, &photometry)?);
            references.push(self.frame(&pair.reference, &photometry)?);
        }
        ctx.tick(count as u64, 2 * count as u64)?;
        // A single frame is an image to the metric, whatever the rate.
        let found = metric.predict_video(&images, &references, self.fps, Color::Linear);
        Ok(Quality { jod: f64::from(found.map_err(failed)?.jod) })
    }
}

impl ColorVideoVdp {
    /// Luminances of the display's three primaries in cd/m2, without the light that the display
    /// reflects, which the metric adds.
    fn frame(&self, image: &Image, photometry: &Photometry) -> Result<Frame, Error> {
        let gain = libm::exp2(f64::from(self.exposure));
        let (white, (black, _)) = (photometry.peak_luminance, photometry.black_level());
        let emitted = |radiance: &Vec3| {
            let light = (gain * radiance.as_dvec3()).clamp(DVec3::ZERO, DVec3::ONE);
            (black + (white - black) * light).as_vec3().to_array()
        };
        let luminance: Vec<[f32; 3]> = image.radiance.par_iter().map(emitted).collect();
        let (width, height) = image.size();
        Frame::new(width, height, 3, luminance.into_flattened()).map_err(failed)
    }
}

fn failed(error: colorvideovdp::Error) -> Error {
    Error::invalid(format!("ColorVideoVDP: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::metrics::trial::{all, plain};
    use crate::kernel::metrics::{pairs::pairs, published_flip::JOD};
    use crate::node::Choice;

    fn run(node: &ColorVideoVdp, images: &[Image], references: &[Image]) -> Result<f64, Error> {
        let input = ColorVideoVdpIn { image: all(images), reference: all(references) };
        node.run(input, &Ctx::default()).map(|found| found.jod)
    }

    fn usual(image: &Image, reference: &Image) -> f64 {
        let one = std::slice::from_ref;
        run(&ColorVideoVdp::default(), one(image), one(reference)).unwrap()
    }

    #[test]
    fn qualities_are_those_of_the_published_tool() {
        use VdpDisplay::{Standard4k, StandardFhd, StandardHdrLinear};
        for (name, image, reference) in pairs() {
            let (_, still, blinking) = JOD.iter().find(|row| row.0 == name).unwrap();
            let near = |found: f64, published: f64| {
                assert!((found - published).abs() < 1e-4, "{name}: {found} not {published}");
            };
            let displays = [Standard4k, StandardFhd, StandardHdrLinear];
            for (display, &published) in displays.into_iter().zip(still) {
                let node = ColorVideoVdp { display, ..ColorVideoVdp::default() };
                let one = std::slice::from_ref;
                near(run(&node, one(&image), one(&reference)).unwrap(), published);
            }
            let frames: Vec<Image> =
                (0..6).map(|k| if k % 2 == 1 { &image } else { &reference }.clone()).collect();
            let truth = vec![reference; 6];
            near(run(&ColorVideoVdp::default(), &frames, &truth).unwrap(), *blinking);
        }
    }

    #[test]
    fn identical_and_black_images_are_perfect() {
        for radiance in [Vec3::ZERO, Vec3::splat(0.5), Vec3::MAX, Vec3::MIN] {
            let image = plain(5, 4, radiance);
            assert_eq!(usual(&image, &image), 10.0);
        }
        // Radiance beyond the display's is its white, radiance below is its black.
        let at = |v: f32| plain(8, 8, Vec3::splat(v));
        assert_eq!(usual(&at(f32::MAX), &at(1.0)), 10.0);
        assert_eq!(usual(&at(f32::MIN), &at(0.0)), 10.0);
    }

    #[test]
    fn brightness_alone_is_not_judged_but_a_shadow_is() {
        let (_, image, reference) = pairs().into_iter().nth(4).unwrap();
        let (width, height) = reference.size();
        let darker = reference.radiance.iter().map(|&r| 0.9 * r).collect();
        assert!(usual(&Image::new(width, height, darker), &reference) > 9.999);
        assert!(usual(&image, &reference) < 7.0);
    }

    #[test]
    fn exposure_is_in_stops_and_fps_matters_to_shots_only() {
        let (_, image, reference) = pairs().into_iter().nth(4).unwrap();
        let halved = |image: &Image| {
            let (width, height) = image.size();
            Image::new(width, height, image.radiance.iter().map(|&r| 0.5 * r).collect())
        };
        let raised = ColorVideoVdp { exposure: 1.0, ..ColorVideoVdp::default() };
        let found = run(&raised, &[halved(&image)], &[halved(&reference)]).unwrap();
        assert_eq!(found, usual(&image, &reference));
        let quick = ColorVideoVdp { fps: 60.0, ..ColorVideoVdp::default() };
        let still = run(&quick, std::slice::from_ref(&image), std::slice::from_ref(&reference));
        assert_eq!(still.unwrap(), usual(&image, &reference));
        let (shot, truth) = ([reference.clone(), image], [reference.clone(), reference]);
        let [slow, fast] =
            [&ColorVideoVdp::default(), &quick].map(|node| run(node, &shot, &truth).unwrap());
        assert!(slow < 10.0 && fast < 10.0 && slow != fast);
    }

    #[test]
    fn quality_does_not_depend_on_threads() {
        let (_, image, reference) = pairs().into_iter().next().unwrap();
        let (shot, truth) = ([reference.clone(), image], [reference.clone(), reference]);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&ColorVideoVdp::default(), &shot, &truth)).unwrap().to_bits()
        };
        assert_eq!(on(1), on(3));
    }

    #[test]
    fn every_display_is_known() {
        let image = plain(4, 4, Vec3::ONE);
        for &(_, display) in <VdpDisplay as Choice>::WORDS {
            let node = ColorVideoVdp { display, ..ColorVideoVdp::default() };
            assert_eq!(
                run(&node, std::slice::from_ref(&image), std::slice::from_ref(&image)).unwrap(),
                10.0
            );
        }
    }

    #[test]
    fn what_has_no_number_is_refused() {
        let error = |i: &[Image], r: &[Image]| {
            run(&ColorVideoVdp::default(), i, r).unwrap_err().to_string()
        };
        let white = plain(4, 4, Vec3::ONE);
        let whites = [white.clone(), white.clone()];
        assert_eq!(error(&whites, &whites[..1]), "there are 2 images but 1 references");
        assert!(error(&[], &[]).contains("no image"));
        let holed = [white.clone(), plain(4, 4, Vec3::NAN)];
        assert!(error(&holed, &whites).starts_with("image 1 is not finite at pixel (0, 0)"));
        assert!(error(&whites, &holed).starts_with("reference 1 is not finite at pixel (0, 0)"));
        let growing = [white, plain(5, 4, Vec3::ONE)];
        assert_eq!(error(&whites, &growing), "image 1 is 4x4 pixels but reference 1 is 5x4");
        assert_eq!(error(&growing, &growing), "image 1 is 5x4 pixels but image 0 is 4x4");
        let dot = [plain(1, 1, Vec3::ONE)];
        assert_eq!(error(&dot, &dot), "image 0 is 1x1 pixels: ColorVideoVDP needs 4x4 or more");
    }
}
