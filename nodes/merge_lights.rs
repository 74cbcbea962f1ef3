//! One list of all lights (Hašan et al. 2008, section 3: everything becomes point lights).

use crate::data::Lights;
use crate::kernel::light_list::LightList;
use crate::node::{Ctx, Error, Item, Many, Node};
use glam::DVec3;

crate::params! {
    /// Puts lights of all kinds in one list, in the order given. Where there are more than `total`, small
    /// parts, as lamps and the sun, stay whole; each large part keeps its share of evenly spaced lights,
    /// scaled so that its power stays the same.
    pub struct MergeLights {
        /// Lights at most.
        total: u32 = 65_536, 1..=16_777_216;
    }
}

crate::inputs! {
    /// Inputs of [`MergeLights`].
    pub struct MergeLightsIn {
        /// Lights of every kind.
        lights: Many<Lights>,
    }
}

impl Node for MergeLights {
    const KIND: &'static str = "MergeLights";
    const VERSION: u32 = 1;
    type In = MergeLightsIn;
    type Out = Lights;

    fn run(&self, input: MergeLightsIn, ctx: &Ctx) -> Result<Lights, Error> {
        let sizes: Vec<usize> = input.lights.iter().map(|l| l.kind.len()).collect();
        let kept = shares(&sizes, self.total as usize);
        let mut list = LightList::new();
        for (part, keep) in input.lights.iter().zip(&kept) {
            append(&mut list, part, *keep);
        }
        let (before, after): (usize, usize) = (sizes.iter().sum(), kept.iter().sum());
        if after < before {
            ctx.note(format!("{after} of {before} lights are kept, with the power of all"));
        }
        Ok(list.finish(input.lights.iter().all(|l| l.identity == 1)))
    }
}

/// How many lights each part keeps: all of a part that is no larger than an equal share of what is
/// left, and of the others as many as their size asks for.
fn shares(sizes: &[usize], total: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| sizes[i]);
    let mut kept = vec![0; sizes.len()];
    let mut left = total;
    for (done, &i) in order.iter().enumerate() {
        let large = &order[done..];
        if sizes[i] <= left / large.len() {
            kept[i] = sizes[i];
            left -= sizes[i];
            continue;
        }
        let sum: usize = large.iter().map(|&j| sizes[j]).sum();
        // Rounded up in turn, so that every light left is given out.
        let mut rest = sum;
        for &j in large {
            kept[j] = (left * sizes[j]).div_ceil(rest).min(left);
            left -= kept[j];
            rest -= sizes[j];
        }
        break;
    }
    kept
}

/// Adds `keep` evenly spaced lights of a part. Which ones depends on the numbers alone, never on the
/// power of a frame, so that a light stays the same light.
fn append(list: &mut LightList, part: &Item<Lights>, keep: usize) {
    let size = part.kind.len();
    let chosen = |i: usize| i * size / keep.max(1);
    let power = |all: &mut dyn Iterator<Item = usize>| all.map(|j| part.emission[j].as_dvec3()).sum::<DVec3>();
    let (whole, some) = (power(&mut (0..size)), power(&mut (0..keep).map(chosen)));
    let ratio = |whole: f64, some: f64| if keep == size || some <= 0.0 { 1.0 } else { whole / some };
    let scale = DVec3::new(ratio(whole.x, some.x), ratio(whole.y, some.y), ratio(whole.z, some.z)).as_vec3();
    for j in (0..keep).map(chosen) {
        list.copy(part, j, scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::cosine_lights;

    fn merged(total: u32, sizes: &[usize]) -> Lights {
        let parts = sizes.iter().map(|&n| Item::from(cosine_lights(n, 1))).collect();
        MergeLights { total }.run(MergeLightsIn { lights: Many(parts) }, &Ctx::default()).unwrap()
    }

    #[test]
    fn everything_fits() {
        let all = merged(100, &[30, 0, 70]);
        assert_eq!((all.kind.len(), all.identity), (100, 1));
        assert_eq!(all.position[30..], cosine_lights(70, 1).position[..]);
    }

    #[test]
    fn fewer_lights_keep_the_power() {
        let sum = |l: &Lights| l.emission.iter().map(|e| e.as_dvec3()).sum::<DVec3>();
        let (all, some) = (merged(1000, &[400, 100]), merged(100, &[400, 100]));
        assert_eq!(some.kind.len(), 100);
        assert!((sum(&all) - sum(&some)).abs().max_element() < 1e-3 * sum(&all).max_element());
    }

    #[test]
    fn shares_add_up() {
        assert_eq!(shares(&[5, 5], 10), [5, 5]);
        assert_eq!(shares(&[1000, 1, 0], 10), [9, 1, 0]);
        assert_eq!(shares(&[3, 3, 3], 2).iter().sum::<usize>(), 2);
        let lamps_sky_bounce = shares(&[3, 16_384, 49_152], 16_387);
        assert_eq!(lamps_sky_bounce, [3, 4096, 12_288]);
    }
}
