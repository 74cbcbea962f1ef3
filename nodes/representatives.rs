//! A representative for each cluster, and the reconstruction matrix (Hašan et al. 2008, section 4.5).

use crate::data::{self, Clusters, Rows};
use crate::kernel::clustering::Cluster;
use crate::kernel::history::cut;
use crate::kernel::ridge::Columns;
use crate::node::{All, Ctx, Error, Item, Node};
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

crate::choice! {
    /// Which member stands for its cluster.
    pub enum Choose {
        /// The one with the largest norm: deterministic, the choice of 2008.
        Max = "max",
        /// One drawn with probability proportional to its norm: the choice of 2007. With
        /// `scale: scalar` the estimate is unbiased over lights that reach a row.
        Random = "random",
        /// The one whose direction is closest to that of the cluster's sum, of those that have at least
        /// a quarter of the largest norm.
        Medoid = "medoid",
    }
}

crate::choice! {
    /// How a representative is scaled to stand for another member.
    pub enum Scale {
        /// By the ratio of the norms of each colour channel.
        Rgb = "rgb",
        /// By the ratio of the norms of the whole columns.
        Scalar = "scalar",
    }
}

crate::choice! {
    /// How bright a representative is made.
    pub enum Fit {
        /// As bright as the lights of its cluster by themselves: the sums of ratios of 2008.
        Cluster = "cluster",
        /// That times a factor, chosen for all representatives of a frame together so that their sum
        /// comes close to the sum of all lights on the rows (ridge regression).
        Rows = "rows",
    }
}

crate::params! {
    /// Cuts the split history at a count and chooses one light-frame pair to render for each cluster.
    pub struct Representatives {
        /// Representatives a frame, on average.
        count: u32 = 200, 1..=65_536;
        /// Which member stands for its cluster.
        choose: Choose = Choose::Max;
        /// How it is scaled to stand for the others.
        scale: Scale = Scale::Rgb;
        /// How bright it is made.
        fit: Fit = Fit::Cluster;
        /// How strongly `fit: rows` holds the factors to 1: the ridge, in mean squares of a row.
        ridge: f64 = 0.03, 0.000_001..=1000.0;
        /// Seed of `choose: random`.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`Representatives`].
    pub struct RepresentativesIn {
        /// The split history.
        clusters: Item<Clusters>,
        /// The rows that were clustered.
        rows: All<Rows>,
    }
}

impl Node for Representatives {
    const KIND: &'static str = "Representatives";
    const VERSION: u32 = 2;
    type In = RepresentativesIn;
    type Out = data::Representatives;

    fn run(&self, input: RepresentativesIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let frames = input.clusters.frames as usize;
        if input.rows.len() != frames {
            let what = format!("the clusters span {frames} frames, the rows {}", input.rows.len());
            return Err(Error::invalid(what));
        }
        let rows: Vec<Item<Rows>> = (0..frames).map(|k| input.rows.get(k)).collect::<Result<_, _>>()?;
        let wanted = self.count as usize * frames;
        let clusters = cut(&input.clusters, wanted)?;
        let available = input.clusters.start.len() + input.clusters.split.len();
        if wanted > available {
            let why = "no more have light, or `limit` or `count` of the node that clusters is lower";
            ctx.note(format!("{available} clusters exist where {wanted} were asked for: {why}"));
        }
        let mut chosen: Vec<Chosen> = clusters
            .par_iter()
            .enumerate()
            .map(|(c, cluster)| {
                ctx.tick(c as u64, clusters.len() as u64)?;
                Ok(self.represent(c, cluster, &rows))
            })
            .collect::<Result<_, Error>>()?;
        chosen.sort_by_key(|c| (c.frame, c.light));
        if self.fit == Fit::Rows {
            self.fit_rows(&mut chosen, &rows);
        }
        Ok(assemble(&chosen, frames))
    }
}

/// A representative and its row of the reconstruction matrix.
struct Chosen {
    light: u32,
    frame: u32,
    first: u32,
    weight: Vec<Vec3>,
}

impl Chosen {
    fn serves(&self, frame: u32) -> bool {
        (self.first..self.first + self.weight.len() as u32).contains(&frame)
    }
}

impl Representatives {
    fn represent(&self, number: usize, cluster: &Cluster, rows: &[Item<Rows>]) -> Chosen {
        let (light, frame) = match self.choose {
            Choose::Max => heaviest(cluster, rows),
            Choose::Random => self.drawn(number, cluster, rows),
            Choose::Medoid => medoid(cluster, rows),
        };
        let rep = norm(rows, light, frame);
        let sum = |k: u32| -> Vec3 {
            let ratios = cluster.lights.iter().map(|&j| self.ratio(norm(rows, j, k), rep));
            ratios.sum::<DVec3>().as_vec3()
        };
        let weight = (cluster.first_frame..cluster.last_frame).map(sum).collect();
        Chosen { light, frame, first: cluster.first_frame, weight }
    }

    /// Factor per channel by which the representative stands for a member. Where it is dark in a
    /// channel, the ratio of the whole columns serves instead, so that no division is by zero.
    fn ratio(&self, member: DVec3, rep: DVec3) -> DVec3 {
        let scalar = if rep.length() > 0.0 { member.length() / rep.length() } else { 0.0 };
        let channel = |m: f64, r: f64| if self.scale == Scale::Rgb && r > 0.0 { m / r } else { scalar };
        DVec3::new(channel(member.x, rep.x), channel(member.y, rep.y), channel(member.z, rep.z))
    }

    /// Multiplies the weights in each frame by what fits them to its rows.
    fn fit_rows(&self, chosen: &mut [Chosen], rows: &[Item<Rows>]) {
        let factors: Vec<Vec<f64>> = (0..rows.len() as u32)
            .into_par_iter()
            .map(|k| {
                let serving = chosen.iter().filter(|c| c.serves(k));
                let weighted = |c: &Chosen| {
                    let rep = norm(rows, c.light, c.frame).length();
                    let all = c.weight[(k - c.first) as usize].as_dvec3() * norm(rows, c.light, c.frame);
                    (column(rows, c.light, c.frame), if rep > 0.0 { all.length() / rep } else { 0.0 })
                };
                Columns { columns: serving.map(weighted).collect() }
                    .factors(&total(&rows[k as usize]), self.ridge)
            })
            .collect();
        for (k, factors) in (0..).zip(factors) {
            for (c, factor) in chosen.iter_mut().filter(|c| c.serves(k)).zip(factors) {
                c.weight[(k - c.first) as usize] *= factor as f32;
            }
        }
    }

    fn drawn(&self, number: usize, cluster: &Cluster, rows: &[Item<Rows>]) -> (u32, u32) {
        let total: f64 = members(cluster).map(|(j, k)| norm(rows, j, k).length()).sum();
        let mut generator = Pcg64Mcg::seed_from_u64(self.seed.wrapping_add((number as u64) << 32));
        let mut left = generator.random::<f64>() * total;
        for (j, k) in members(cluster) {
            left -= norm(rows, j, k).length();
            if left < 0.0 {
                return (j, k);
            }
        }
        heaviest(cluster, rows)
    }
}

fn members(cluster: &Cluster) -> impl Iterator<Item = (u32, u32)> {
    cluster.lights.iter().flat_map(|&j| (cluster.first_frame..cluster.last_frame).map(move |k| (j, k)))
}

/// Per-channel norm of a reduced column.
fn norm(rows: &[Item<Rows>], light: u32, frame: u32) -> DVec3 {
    rows[frame as usize].norm[light as usize].as_dvec3()
}

/// A light's elements on the rows of a frame.
fn column(rows: &[Item<Rows>], light: u32, frame: u32) -> &[f32] {
    let rows = &rows[frame as usize];
    &rows.reduced[light as usize * rows.pixel.len()..][..rows.pixel.len()]
}

/// Sum of all lights on each row.
fn total(rows: &Rows) -> Vec<f64> {
    let mut sum = vec![0.0; rows.pixel.len()];
    for column in rows.reduced.chunks_exact(rows.pixel.len().max(1)) {
        sum.iter_mut().zip(column).for_each(|(sum, x)| *sum += f64::from(*x));
    }
    sum
}

fn heaviest(cluster: &Cluster, rows: &[Item<Rows>]) -> (u32, u32) {
    best(cluster, |j, k| norm(rows, j, k).length_squared())
}

/// The member with the largest score; of equals, the first by light, then frame.
fn best(cluster: &Cluster, score: impl Fn(u32, u32) -> f64) -> (u32, u32) {
    let mut best = (cluster.lights[0], cluster.first_frame, f64::NEG_INFINITY);
    for (j, k) in members(cluster) {
        let value = score(j, k);
        if value > best.2 {
            best = (j, k, value);
        }
    }
    (best.0, best.1)
}

/// Norm that a medoid has at least, of the largest in its cluster. One that is nearly dark on the rows
/// may be bright elsewhere, and scaling it up to stand for others would show it there as a spot.
const LIGHTEST: f64 = 0.25;

fn medoid(cluster: &Cluster, rows: &[Item<Rows>]) -> (u32, u32) {
    let height = (cluster.first_frame..cluster.last_frame).map(|k| rows[k as usize].pixel.len()).max();
    let mut sum = vec![0.0_f64; height.unwrap_or(0)];
    for (j, k) in members(cluster) {
        sum.iter_mut().zip(column(rows, j, k)).for_each(|(s, &x)| *s += f64::from(x));
    }
    let (j, k) = heaviest(cluster, rows);
    let least = LIGHTEST * norm(rows, j, k).length();
    best(cluster, |j, k| {
        let dot: f64 = column(rows, j, k).iter().zip(&sum).map(|(&x, s)| f64::from(x) * s).sum();
        let length = norm(rows, j, k).length();
        if length > 0.0 && length >= least { dot / length } else { f64::NEG_INFINITY }
    })
}

fn assemble(chosen: &[Chosen], frames: usize) -> data::Representatives {
    let mut first = 0;
    let first_weight = chosen.iter().map(|c| {
        first += c.weight.len() as u32;
        first - c.weight.len() as u32
    });
    data::Representatives {
        first_weight: first_weight.collect(),
        pair: chosen.iter().map(|c| [c.light, c.frame]).collect(),
        frames: chosen.iter().map(|c| [c.first, c.first + c.weight.len() as u32]).collect(),
        weight: chosen.iter().flat_map(|c| c.weight.iter().copied()).collect(),
        count: frames as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Array;

    /// Two rows a light: red and grey lights of growing norm.
    fn frame() -> Item<Rows> {
        let columns = [[1.0, 0.0], [2.0, 0.0], [0.0, 5.0]];
        let norm = vec![Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 2.0, 0.0), Vec3::new(3.0, 4.0, 0.0)];
        Item::from(Rows {
            reduced: Array::shaped(columns.concat(), &[3, 2]),
            norm: norm.into(),
            pixel: vec![0, 1].into(),
            identity: 1,
        })
    }

    fn all(frames: u32) -> Cluster {
        Cluster { lights: vec![0, 1, 2], first_frame: 0, last_frame: frames }
    }

    #[test]
    fn the_largest_norm_stands_for_its_cluster() {
        let rows = [frame(), frame()];
        let chosen = Representatives::default().represent(0, &all(2), &rows);
        assert_eq!((chosen.light, chosen.frame, chosen.weight.len()), (2, 0, 2));
        // Blue falls back to the scalar ratios 1/5 + 2/5 + 1.
        let expected = Vec3::new(1.0 / 3.0 + 1.0, 2.0 / 4.0 + 1.0, 1.6);
        assert!((chosen.weight[1] - expected).abs().max_element() < 1e-6, "{}", chosen.weight[1]);
    }

    #[test]
    fn dark_channels_and_dark_clusters_stay_finite() {
        let node = Representatives::default();
        assert_eq!(node.ratio(DVec3::Z, DVec3::X), DVec3::new(0.0, 1.0, 1.0));
        assert_eq!(node.ratio(DVec3::X, DVec3::ZERO), DVec3::ZERO);
    }

    #[test]
    fn random_choice_follows_the_norms_and_scalar_weights_are_unbiased() {
        let rows = [frame()];
        let (mut picked, mut estimate) = ([0_u32; 3], DVec3::ZERO);
        let draws = 20_000;
        for seed in 0..draws {
            let node = Representatives { choose: Choose::Random, scale: Scale::Scalar, seed, ..Default::default() };
            let chosen = node.represent(0, &all(1), &rows);
            picked[chosen.light as usize] += 1;
            estimate += norm(&rows, chosen.light, 0) * chosen.weight[0].as_dvec3() / draws as f64;
        }
        let share = picked.map(|p| f64::from(p) / draws as f64);
        for (share, expected) in share.into_iter().zip([0.125, 0.25, 0.625]) {
            assert!((share - expected).abs() < 0.02, "{picked:?}");
        }
        let truth = DVec3::new(4.0, 6.0, 0.0);
        assert!((estimate - truth).abs().max_element() < 0.1, "{estimate}");
    }

    #[test]
    fn weights_fit_the_rows_of_their_frame() {
        // Light 2 stands for 0 and 1, which the first row has and it has not; light 1 stands for itself.
        let rows = [frame()];
        let chosen = |light, weight| Chosen { light, frame: 0, first: 0, weight: vec![Vec3::splat(weight)] };
        let fitted = |ridge| {
            let mut both = [chosen(2, 1.6), chosen(1, 1.0)];
            Representatives { fit: Fit::Rows, ridge, ..Default::default() }.fit_rows(&mut both, &rows);
            both.map(|c| c.weight[0])
        };
        // The rows sum up to 3 and 5.
        let [two, one] = fitted(1e-6);
        assert!((two - 1.0).abs().max_element() < 1e-3 && (one - 1.5).abs().max_element() < 1e-3, "{two} {one}");
        let [two, one] = fitted(1000.0);
        assert!((two - 1.6).abs().max_element() < 1e-2 && (one - 1.0).abs().max_element() < 1e-2, "{two} {one}");
    }

    #[test]
    fn the_medoid_points_along_the_sum() {
        let rows = [frame()];
        assert_eq!(medoid(&all(1), &rows), (2, 0));
        assert_eq!(medoid(&Cluster { lights: vec![0, 1], first_frame: 0, last_frame: 1 }, &rows).0, 0);
    }
}
