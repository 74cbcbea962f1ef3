//! Where directions meet a micro-buffer, eight at once: the same bits as [`MicroBuffer::solid_angle`] and [`MicroBuffer::place`].

use super::buffer::{MicroBuffer, Shape};
use crate::kernel::lanes::{Lanes, Triple, WIDTH};
use std::f32::consts::PI;

/// [`Place`]s side by side.
pub(super) struct Places<L> {
    pub(super) patch: L,
    pub(super) u: L,
    pub(super) v: L,
}

impl MicroBuffer {
    /// Solid angles of the cells around unit directions on or above the horizon.
    #[inline(always)]
    pub(super) fn solid_angles<L: Lanes>(&self, d: Triple<L>) -> L {
        let n = self.resolution as f32;
        match self.shape {
            Shape::Cube => {
                let side = d.x.abs().max(d.y.abs());
                let top = L::splat(4.0 / (n * n)) * (d.z * d.z * d.z);
                let sides = L::splat(2.0 / (n * self.patches[1].rows as f32));
                top.or(d.z.ge(side), sides * (side * side * side))
            }
            Shape::Lambert => {
                let rim = L::splat(((n - 1.0).sqrt() / n).clamp(f32::MIN_POSITIVE, 0.5));
                L::splat(PI) / (L::splat(n * n) * d.z.max(rim))
            }
        }
    }

    /// Where unit directions on or above the horizon meet the buffer. What lanes outside of `mask` give means nothing.
    #[inline(always)]
    pub(super) fn places<L: Lanes>(&self, d: Triple<L>, mask: u32) -> Places<L> {
        match self.shape {
            Shape::Cube => self.places_on_cube(d),
            Shape::Lambert => {
                let (mut u, mut v) = ([0.0; WIDTH], [0.0; WIDTH]);
                for (lane, direction) in d.store().into_iter().enumerate() {
                    if mask >> lane & 1 == 1 {
                        let place = self.place(direction);
                        (u[lane], v[lane]) = (place.u, place.v);
                    }
                }
                Places { patch: L::splat(0.0), u: L::load(&u), v: L::load(&v) }
            }
        }
    }

    #[inline(always)]
    fn places_on_cube<L: Lanes>(&self, d: Triple<L>) -> Places<L> {
        let number = L::splat;
        let n = number(self.resolution as f32);
        let (x, y, zero) = (d.x.abs(), d.y.abs(), number(0.0));
        let reach = x.max(y);
        let (top, along_x) = (d.z.ge(reach), x.ge(y));
        let (right, back) = (d.x.gt(zero), d.y.gt(zero));
        let side = number(1.0).or(right, number(3.0));
        let side = side.or(along_x, number(2.0).or(back, number(4.0)));
        let s = d.y.or(right, d.y.negated());
        let s = s.or(along_x, d.x.negated().or(back, d.x));
        let s = d.x.or(top, s) / d.z.or(top, reach);
        let half = number(0.5);
        let u = (s + number(1.0)) * half * n;
        let above = (d.y / d.z + number(1.0)) * half * n;
        let beside = d.z / reach * number(self.patches[1].rows as f32);
        let v = above.or(top, beside);
        Places { patch: zero.or(top, side), u, v }
    }
}

#[cfg(test)]
mod tests {
    use super::super::buffer::Place;
    use super::*;
    use crate::kernel::lanes::Portable;
    use crate::kernel::pbgi::fixtures::unit_vectors;
    use glam::Vec3;

    #[test]
    fn eight_are_what_one_is() {
        let mut directions: Vec<Vec3> =
            unit_vectors(4000, 5).into_iter().map(|d| Vec3::new(d.x, d.y, d.z.abs())).collect();
        let third = 3.0_f32.sqrt().recip();
        directions.extend([Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z]);
        directions.extend([Vec3::splat(third), Vec3::new(-third, third, third), Vec3::ZERO]);
        for shape in [Shape::Cube, Shape::Lambert] {
            for resolution in [1, 7, 8] {
                let buffer = MicroBuffer::new(shape, resolution);
                for eight in directions.as_chunks::<WIDTH>().0 {
                    let each = Triple::<Portable>::load(eight);
                    let angles = buffer.solid_angles(each).store();
                    let Places { patch, u, v } = buffer.places(each, 0xff);
                    let found = [patch, u, v].map(Portable::store);
                    for (lane, &d) in eight.iter().enumerate() {
                        assert_eq!(angles[lane].to_bits(), buffer.solid_angle(d).to_bits(), "{d}");
                        if d == Vec3::ZERO {
                            continue;
                        }
                        let Place { patch, u, v } = buffer.place(d);
                        assert_eq!([patch as f32, u, v], found.map(|f| f[lane]), "{d}");
                    }
                }
            }
        }
    }
}
