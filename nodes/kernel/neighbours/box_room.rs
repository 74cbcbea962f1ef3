//! Deep framebuffers of a plain room, ray cast, for the tests.

use super::{Features, Frame, Weights};

/// The buffers of one frame.
#[derive(Debug)]
pub struct Picture {
    pub width: u32,
    pub height: u32,
    pub position: Vec<[f32; 3]>,
    pub normal: Vec<[f32; 3]>,
    pub albedo: Vec<[f32; 3]>,
    pub valid: Vec<u8>,
}

impl Picture {
    /// The picture's vectors, weighted as the tests have it.
    pub fn features(&self, centre: [f64; 3], diagonal: f64) -> Features {
        let frame = Frame {
            width: self.width,
            height: self.height,
            position: &self.position,
            normal: &self.normal,
            albedo: &self.albedo,
            valid: &self.valid,
        };
        let weights = Weights { position: 1.0, normal: 0.125, albedo: 0.25 };
        Features::new(&frame, centre, diagonal, weights).expect("the picture is in order")
    }
}

/// Low corner, high corner, reflectance, and the size of the checks that darken it.
type Block = ([f64; 3], [f64; 3], [f32; 3], f64);

/// The room, which is seen from inside, and what stands in it. The wall that faces +z is missing.
const BLOCKS: [Block; 5] = [
    ([-4.0, 0.0, -5.0], [4.0, 3.0, 5.0], [0.8, 0.75, 0.7], 0.8),
    ([-2.5, 0.0, -3.5], [-1.2, 1.7, -2.3], [0.2, 0.4, 0.7], 9.0),
    ([0.3, 0.0, -2.0], [1.6, 0.9, -0.6], [0.7, 0.3, 0.2], 0.3),
    ([2.0, 0.0, -4.4], [3.1, 2.4, -3.3], [0.3, 0.6, 0.3], 9.0),
    ([-0.8, 0.7, -1.6], [-0.5, 1.0, -1.3], [0.6, 0.6, 0.1], 9.0),
];

/// The room's centre.
pub const CENTRE: [f64; 3] = [0.0, 1.5, 0.0];

/// The room's diagonal.
pub const DIAGONAL: f64 = 13.15;

/// Casts one ray through each pixel's centre from `eye`, looking along -z turned by `yaw` radians about y.
pub fn picture(width: u32, height: u32, eye: [f64; 3], yaw: f64) -> Picture {
    let count = (width * height) as usize;
    let (position, normal, albedo, valid) =
        (vec![[0.0; 3]; count], vec![[0.0; 3]; count], vec![[0.0; 3]; count], vec![0; count]);
    let mut picture = Picture { width, height, position, normal, albedo, valid };
    let (sin, cos) = yaw.sin_cos();
    for pixel in 0..count {
        let (column, row) = (pixel % width as usize, pixel / width as usize);
        let x = (column as f64 + 0.5 - f64::from(width) / 2.0) / f64::from(height) * 1.2;
        let y = (f64::from(height) / 2.0 - row as f64 - 0.5) / f64::from(height) * 1.2;
        let ray = [x * cos - sin, y, -x * sin - cos];
        if let Some((position, normal, albedo)) = cast(eye, ray) {
            picture.position[pixel] = position.map(|c| c as f32);
            picture.normal[pixel] = normal;
            picture.albedo[pixel] = albedo;
            picture.valid[pixel] = 1;
        }
    }
    picture
}

/// The nearest surface along a ray.
fn cast(eye: [f64; 3], ray: [f64; 3]) -> Option<([f64; 3], [f32; 3], [f32; 3])> {
    let mut nearest = f64::INFINITY;
    let mut hit = None;
    for (index, (low, high, colour, check)) in BLOCKS.iter().enumerate() {
        let (mut near, mut far) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
        for axis in 0..3 {
            let (a, b) =
                ((low[axis] - eye[axis]) / ray[axis], (high[axis] - eye[axis]) / ray[axis]);
            if a.min(b) > near.0 {
                near = (a.min(b), axis);
            }
            if a.max(b) < far.0 {
                far = (a.max(b), axis);
            }
        }
        let inside = index == 0;
        let (t, axis) = if inside { far } else { near };
        let missed = near.0 > far.0 || t <= 0.0 || (inside && axis == 2 && ray[2] > 0.0);
        if missed || t >= nearest {
            continue;
        }
        nearest = t;
        let position = [0, 1, 2].map(|c| eye[c] + t * ray[c]);
        let mut normal = [0.0; 3];
        normal[axis] = if ray[axis] > 0.0 { -1.0 } else { 1.0 };
        let checks: f64 =
            [0, 1, 2].iter().filter(|c| **c != axis).map(|&c| (position[c] / check).floor()).sum();
        let shade = if checks.rem_euclid(2.0) < 0.5 { 1.0 } else { 0.6 };
        hit = Some((position, normal, colour.map(|c| c * shade)));
    }
    hit
}

/// A plain wall of one reflectance that fills the picture. A pixel sees the point `(column + shift, row)` times 1/16.
pub fn wall(width: u32, height: u32, shift: f64) -> Picture {
    let at =
        |pixel: u32| [(f64::from(pixel % width) + shift) / 16.0, f64::from(pixel / width) / 16.0];
    let position =
        (0..width * height).map(|pixel| [at(pixel)[0] as f32, at(pixel)[1] as f32, 2.0]).collect();
    flat(width, height, position)
}

/// A picture whose pixels all see the same point.
pub fn constant(width: u32, height: u32) -> Picture {
    flat(width, height, vec![[1.0, 2.0, 2.0]; (width * height) as usize])
}

/// A picture that sees nothing.
pub fn background(width: u32, height: u32) -> Picture {
    Picture { valid: vec![0; (width * height) as usize], ..constant(width, height) }
}

/// A picture of one normal and one reflectance.
fn flat(width: u32, height: u32, position: Vec<[f32; 3]>) -> Picture {
    let count = position.len();
    let (normal, albedo, valid) =
        (vec![[0.0, 0.0, -1.0]; count], vec![[0.5, 0.5, 0.5]; count], vec![1; count]);
    Picture { width, height, position, normal, albedo, valid }
}
