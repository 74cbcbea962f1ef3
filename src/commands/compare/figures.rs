//! How far the images of two sides are apart, by every metric there is, and as pictures.

use super::side::Side;
use crate::engine::mean;
use crate::report::{Axis, Document, Encoded, Fate, Plot, Point, Setting, Spread};
use lightloom_nodes as nodes;
use nodes::data::{Image, Picture};
use nodes::node::{All, Ctx, Error, Item, Node};
use std::time::{SystemTime, UNIX_EPOCH};

/// What was found.
pub struct Judged {
    /// Mean over the images of every figure.
    pub figures: Vec<(String, f64)>,
    /// Metrics that have no answer here, and why.
    pub unknown: Vec<(String, String)>,
    /// Pictures of the middle images: A, B, their difference and FLIP map.
    pictures: [Encoded; 4],
}

impl Judged {
    /// Judges `image` against `reference`.
    ///
    /// # Errors
    /// When they cannot be compared at all: numbers or sizes differ, or a pixel is not finite.
    pub fn new(image: &All<Image>, reference: &All<Image>) -> Result<Self, Error> {
        let ctx = Ctx::default();
        let (i, r) = (|| image.clone(), || reference.clone());
        let mut figures = Vec::new();
        let mut unknown = Vec::new();
        let all =
            nodes::Compare::default().run(nodes::CompareIn { image: i(), reference: r() }, &ctx)?;
        for (name, value) in [
            ("relative_l2", mean(&all.relative_l2)),
            ("rmse", mean(&all.rmse)),
            ("rel_mse", mean(&all.rel_mse)),
            ("psnr", mean(&all.psnr)),
            ("psnr_linear", mean(&all.psnr_linear)),
            ("error99", mean(&all.error99)),
            ("energy", mean(&all.energy)),
            ("flicker", all.flicker),
            ("static_deviation", all.static_deviation),
        ] {
            figures.push((name.to_owned(), value));
        }
        let ssim = nodes::SsimIn { image: i(), reference: r() };
        let ssim = nodes::Ssim::default().run(ssim, &ctx).map(|s| mean(&s.ssim));
        let flip = nodes::FlipIn { image: i(), reference: r() };
        let flip = nodes::Flip::default().run(flip, &ctx).map(|f| mean(&f.flip));
        let yee = nodes::PerceptualDifferencesIn { image: i(), reference: r() };
        let yee =
            nodes::PerceptualDifferences::default().run(yee, &ctx).map(|y| mean(&y.different));
        let vdp = nodes::ColorVideoVdpIn { image: i(), reference: r() };
        let vdp = nodes::ColorVideoVdp::default().run(vdp, &ctx).map(|v| v.jod);
        for (name, found) in [("ssim", ssim), ("flip", flip), ("different", yee), ("jod", vdp)] {
            match found {
                Ok(value) => figures.push((name.to_owned(), value)),
                Err(problem) => unknown.push((name.to_owned(), problem.to_string())),
            }
        }
        let middle = image.len() / 2;
        let (a, b) = (image.get(middle)?, reference.get(middle)?);
        let difference = nodes::DifferenceIn { image: a.clone(), reference: b.clone() };
        let difference = nodes::Difference::default().run(difference, &ctx)?;
        let map = nodes::FlipMapIn { image: a.clone(), reference: b.clone() };
        let map = nodes::FlipMap::default().run(map, &ctx)?;
        let png = |image: Item<Image>, png: nodes::Png| -> Result<Encoded, Error> {
            let Picture { bytes, .. } = png.run(nodes::PngIn { image }, &ctx)?;
            Ok(Encoded { bytes: bytes.to_vec(), extension: "png".into() })
        };
        let plain = nodes::Png::default;
        let clipped = nodes::Png { tone: nodes::kernel::tone::Tone::Clip, ..plain() };
        let pictures = [
            png(a, plain())?,
            png(b, plain())?,
            png(difference.into(), plain())?,
            png(map.into(), clipped)?,
        ];
        Ok(Judged { figures, unknown, pictures })
    }

    /// The comparison as a report: both sides as settings, the figures with the first.
    pub fn document(&self, a: &Side, b: &Side) -> Document {
        let point = |setting: usize, side: &Side, pictures: &[(&str, usize)]| Point {
            setting,
            fate: Fate::Done,
            evaluations: side.cost.map(|c| c.evaluations),
            cpu_seconds: side.cost.map(|c| c.cpu_seconds),
            pictures: pictures.iter().map(|(name, at)| ((*name).to_owned(), *at)).collect(),
            graph: side
                .parameters
                .iter()
                .map(|(name, value)| format!("{name}: {value}\n"))
                .collect(),
            ..Point::default()
        };
        let one = |mean: f64| Spread { mean, deviation: 0.0, count: 1 };
        let setting = |at: usize, side: &Side| Setting {
            values: vec![side.label.clone()],
            points: vec![at],
            evaluations: side.cost.map(|c| one(c.evaluations as f64)),
            cpu_seconds: side.cost.map(|c| one(c.cpu_seconds)),
            ..Setting::default()
        };
        let mut first = point(0, a, &[("image", 0), ("5x difference", 2), ("FLIP", 3)]);
        first.figures = self.figures.iter().cloned().collect();
        let mut judged = setting(0, a);
        judged.figures =
            self.figures.iter().map(|(name, value)| (name.clone(), one(*value))).collect();
        Document {
            title: "comparison".into(),
            source: format!("{} against {}", a.label, b.label),
            made: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
            version: env!("CARGO_PKG_VERSION").into(),
            axes: vec![Axis {
                name: "side".into(),
                values: vec![a.label.clone(), b.label.clone()],
            }],
            figures: self.figures.iter().map(|(name, _)| name.clone()).collect(),
            plot: Plot { x: "evaluations".into(), y: "relative_l2".into(), colour: None },
            settings: vec![judged, setting(1, b)],
            points: vec![first, point(1, b, &[("image", 1)])],
            pictures: self.pictures.to_vec(),
            ..Document::default()
        }
    }
}
