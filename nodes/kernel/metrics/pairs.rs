//! Five pairs of pictures, a test and its reference, on which the metrics are compared with the
//! values of public tools. The formulas use no function whose last bit depends on the machine.

use crate::data::Image;
use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const WIDTH: usize = 96;
const HEIGHT: usize = 64;
const DECADES: [f32; 7] = [1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0];

/// (name, test, reference) of each pair: 96x64 pixels of linear RGB.
pub fn pairs() -> [(&'static str, Image, Image); 5] {
    [noise(), blur(), shift(), hdr(), dark()]
}

/// A smooth gradient in colour, under noise.
fn noise() -> (&'static str, Image, Image) {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let reference = picture(|x, y| {
        let (u, v) = (x as f32 / WIDTH as f32, y as f32 / HEIGHT as f32);
        Vec3::new(0.1 + 0.7 * u, 0.2 + 0.5 * v, 0.6 - 0.4 * u * v)
    });
    let test = change(&reference, |radiance| {
        radiance * Vec3::from_array(std::array::from_fn(|_| 0.75 + 0.5 * random.random::<f32>()))
    });
    ("noise", test, reference)
}

/// A chequered floor and a bright disc, against the same through a box of 3x3 pixels.
fn blur() -> (&'static str, Image, Image) {
    let reference = picture(|x, y| {
        let (dx, dy) = (x as f32 - 60.0, y as f32 - 30.0);
        match (dx * dx + dy * dy < 300.0, (x / 7 + y / 5) % 2) {
            (true, _) => Vec3::new(0.95, 0.8, 0.3),
            (false, 0) => Vec3::new(0.6, 0.55, 0.5),
            (false, _) => Vec3::new(0.05, 0.08, 0.2),
        }
    });
    let test = picture(|x, y| {
        let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        let count = near(x, WIDTH).len() * near(y, HEIGHT).len();
        let inside = near(y, HEIGHT).flat_map(|y| near(x, WIDTH).map(move |x| y * WIDTH + x));
        inside.map(|p| reference.radiance[p]).sum::<Vec3>() / count as f32
    });
    ("blur", test, reference)
}

/// A random texture of 4x4-pixel patches with random shades inside, moved right by one pixel.
fn shift() -> (&'static str, Image, Image) {
    let mut random = Pcg64Mcg::seed_from_u64(2);
    let patches: Vec<Vec3> = (0..WIDTH / 4 * HEIGHT / 4)
        .map(|_| Vec3::from_array(std::array::from_fn(|_| 0.1 + 0.8 * random.random::<f32>())))
        .collect();
    let reference =
        picture(|x, y| patches[y / 4 * (WIDTH / 4) + x / 4] * (0.7 + 0.3 * random.random::<f32>()));
    let test = picture(|x, y| reference.radiance[y * WIDTH + x.saturating_sub(1)]);
    ("shift", test, reference)
}

/// Radiance from 1e-4 to 1e3 across the picture; the test has fireflies.
fn hdr() -> (&'static str, Image, Image) {
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let reference = picture(|x, y| {
        // Seven decades, each a straight line.
        let decades = 7.0 * (x as f32 / (WIDTH - 1) as f32);
        let whole = (decades as usize).min(6);
        let light = DECADES[whole] * (1.0 + 9.0 * (decades - whole as f32));
        let tint = 0.8 * (y as f32 / (HEIGHT - 1) as f32);
        light * Vec3::new(1.0 - 0.5 * tint, 0.9, 0.2 + tint)
    });
    let test = change(&reference, |radiance| {
        let (chosen, factor) = (random.random::<f32>(), random.random::<f32>());
        if chosen < 0.01 {
            radiance * (20.0 + 80.0 * factor)
        } else {
            radiance * (0.98 + 0.04 * factor)
        }
    });
    ("hdr", test, reference)
}

/// A scene with a soft round shadow; the test lacks a tenth of the light and most of the shadow.
fn dark() -> (&'static str, Image, Image) {
    let shadow = |x: usize, y: usize| {
        let (dx, dy) = (x as f32 - 40.0, y as f32 - 34.0);
        (1.0 - (dx * dx + 2.0 * dy * dy) / 600.0).clamp(0.0, 1.0)
    };
    let lit = |x: usize, y: usize| {
        let stripe = if (x / 12).is_multiple_of(2) { 0.5 } else { 0.35 };
        Vec3::new(stripe, 0.9 * stripe, 0.7 * stripe) * (0.3 + 0.7 * y as f32 / HEIGHT as f32)
    };
    let reference = picture(|x, y| lit(x, y) * (1.0 - 0.8 * shadow(x, y)));
    let test = picture(|x, y| 0.9 * lit(x, y) * (1.0 - 0.2 * shadow(x, y)));
    ("dark", test, reference)
}

fn picture(mut of: impl FnMut(usize, usize) -> Vec3) -> Image {
    let pixels = (0..WIDTH * HEIGHT).map(|p| of(p % WIDTH, p / WIDTH)).collect();
    Image::new(WIDTH, HEIGHT, pixels)
}

fn change(image: &Image, mut to: impl FnMut(Vec3) -> Vec3) -> Image {
    picture(|x, y| to(image.radiance[y * WIDTH + x]))
}
