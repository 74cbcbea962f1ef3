//! Top-down clustering of light-frame pairs into rectangles (Hašan 2008, section 4.3.2).

use std::collections::BinaryHeap;
use std::ops::Range;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;

use super::cost::Rectangle;
use super::history::{Extent, History};
use super::queue::{Candidate, Total};
use super::split::{Cut, Evaluation, Split, evaluate, parts};
use super::{Beat, Draw, Error, Tensor, Tick, multiset, project, random};

/// Clusters evaluated at once: those of the highest cost. The result does not depend on it.
const BATCH: usize = 16;

/// What decides the clustering of a tensor.
#[derive(Debug, Clone)]
pub struct Settings<'a> {
    /// Clusters of lights, over all frames of a segment between camera cuts, to start from; drawn with replacement, so fewer
    /// may come out. The paper suggests 100.
    pub start: usize,
    /// Number of clusters at which to stop.
    pub limit: usize,
    /// Factor on the cost after a split in time when it is compared with that after a split in lights: 1 is the paper's
    /// algorithm, more makes longer clusters. Positive and finite.
    pub time_weight: f64,
    /// Seed of all random draws.
    pub seed: u64,
    /// The frames at which a new segment starts because pixel maps do not reach across (camera cuts): increasing, in 1..frames.
    /// No cluster spans one.
    pub cuts: &'a [usize],
}

/// Clusters the light-frame pairs of a tensor into rectangles, J x K: clusters of lights by multi-set sampling on the unfolded
/// and projected slabs, then always the cluster of highest cost split in time or in lights, whichever leaves the lower cost,
/// up to `limit`. With camera cuts, each segment starts with clusters of its own.
///
/// Lights without any contribution in a segment make up its dark rectangle. Both sides of every split have weight, so there are
/// at most as many clusters as pairs that contribute, and with a limit as large each of these is in a cluster without
/// another. Clusters of cost 0 (all columns parallel up to the rounding of their entries) are split last, the heaviest
/// first, each at half its weight. A tensor of zeros gives no cluster at all.
///
/// Multiplying all entries by a power of two changes nothing. Permuting the lights permutes the clusters as far as the same
/// lights are drawn (draws go by number) and no two splits are equal up to rounding.
///
/// Fails on settings out of range, including a limit below the starting clusters of all segments, and when `tick` does.
pub fn cluster_tensor<E>(tensor: &Tensor, settings: &Settings, tick: &Tick<E>) -> Result<History, E>
where
    E: From<Error> + Send,
{
    let segments = check(tensor, settings)?;
    let found = AtomicUsize::new(0);
    let beat = || tick(found.load(Relaxed) as u64, settings.limit as u64);
    let mut state = State::new(tensor, settings);
    for segment in segments {
        state.start(segment, &beat)?;
    }
    state.evaluate_start(&beat)?;
    found.store(state.slots.len(), Relaxed);
    while state.slots.len() < settings.limit && state.split_highest(&beat)? {
        found.store(state.slots.len(), Relaxed);
    }
    Ok(state.history)
}

/// The segments between the cuts.
fn check(tensor: &Tensor, settings: &Settings) -> Result<Vec<Range<usize>>, Error> {
    let &Settings { start, limit, time_weight, cuts, .. } = settings;
    if start == 0 {
        return Err(Error::Start);
    }
    if !(time_weight > 0.0 && time_weight.is_finite()) {
        return Err(Error::TimeWeight(time_weight));
    }
    let mut segments = Vec::with_capacity(cuts.len() + 1);
    let mut first = 0;
    for &cut in cuts {
        if cut <= first || cut >= tensor.frames() {
            return Err(Error::Cut { cut, frames: tensor.frames() });
        }
        segments.push(first..cut);
        first = cut;
    }
    segments.push(first..tensor.frames());
    let start = start.saturating_mul(segments.len());
    if limit < start { Err(Error::Limit { limit, start }) } else { Ok(segments) }
}

/// A cluster of the present clustering.
struct Slot {
    extent: Extent,
    /// Number by creation, which seeds its draws.
    node: u64,
    /// Its cost, once known.
    cost: Option<f64>,
    /// Its best split, once found.
    split: Option<Split>,
}

struct State<'a> {
    tensor: &'a Tensor,
    settings: &'a Settings<'a>,
    history: History,
    slots: Vec<Slot>,
    heap: BinaryHeap<Candidate>,
    total: Total,
    nodes: u64,
}

impl<'a> State<'a> {
    fn new(tensor: &'a Tensor, settings: &'a Settings<'a>) -> State<'a> {
        State {
            tensor,
            settings,
            history: History::default(),
            slots: Vec::new(),
            heap: BinaryHeap::new(),
            total: Total::default(),
            nodes: 0,
        }
    }

    /// The starting clusters and the dark rectangle of a segment.
    fn start<E: Send>(&mut self, segment: Range<usize>, beat: &Beat<E>) -> Result<(), E> {
        let norm = |light: &u32| {
            let norms = self.tensor.norms(*light as usize, segment.clone());
            norms.iter().map(|w| w * w).sum::<f64>().sqrt()
        };
        let all = 0..self.tensor.lights() as u32;
        let (lit, dark): (Vec<u32>, Vec<u32>) = all.partition(|light| norm(light) > 0.0);
        if !dark.is_empty() {
            let extent = self.append(&dark, &segment);
            self.history.dark.extend(extent.numbers());
        }
        if lit.is_empty() {
            return Ok(());
        }
        let clusters = if self.settings.start == 1 {
            vec![lit]
        } else {
            let seed = self.settings.seed;
            let norms: Vec<f64> = lit.iter().map(norm).collect();
            let (directions, dimensions) =
                project::directions(self.tensor, &lit, segment.clone(), seed, beat)?;
            let mut random = random(seed, Draw::Sampling, segment.start as u64);
            let count = self.settings.start;
            let clusters =
                multiset::sample(&norms, &directions, dimensions, count, &mut random, beat)?;
            let numbers = |cluster: Vec<u32>| cluster.iter().map(|&at| lit[at as usize]).collect();
            clusters.into_iter().map(numbers).collect()
        };
        for lights in clusters {
            let extent = self.append(&lights, &segment);
            self.history.start.extend(extent.numbers());
            self.slots.push(Slot { extent, node: self.nodes, cost: None, split: None });
            self.nodes += 1;
        }
        Ok(())
    }

    fn append(&mut self, lights: &[u32], frames: &Range<usize>) -> Extent {
        let start = self.history.lights.len() as u32;
        self.history.lights.extend(lights);
        Extent {
            start,
            len: lights.len() as u32,
            first: frames.start as u32,
            last: frames.end as u32,
        }
    }

    /// Costs and splits of the starting clusters.
    fn evaluate_start<E: Send>(&mut self, beat: &Beat<E>) -> Result<(), E> {
        let mut first = 0;
        while first < self.slots.len() {
            let batch = self.batch(first..self.slots.len());
            first += batch.len();
            for (at, evaluation) in self.evaluate(&batch, beat)? {
                let Evaluation { weight, cost, split } = evaluation;
                self.total.set(at, cost);
                if split.is_some() {
                    self.heap.push(Candidate { cost, weight, node: self.slots[at].node, at });
                }
                self.slots[at].cost = Some(cost);
                self.slots[at].split = split;
            }
        }
        if !self.slots.is_empty() {
            self.history.costs.push(self.total.get());
        }
        Ok(())
    }

    /// Splits the cluster of highest cost; false if none can be split.
    fn split_highest<E: Send>(&mut self, beat: &Beat<E>) -> Result<bool, E> {
        loop {
            let Some(candidate) = self.heap.pop() else { return Ok(false) };
            if let Some(split) = self.slots[candidate.at].split.take() {
                self.apply(candidate.at, &split);
                return Ok(true);
            }
            self.heap.push(candidate);
            self.evaluate_highest(beat)?;
        }
    }

    /// Finds the splits of the clusters of highest cost that have none yet, and drops those that cannot be split.
    fn evaluate_highest<E: Send>(&mut self, beat: &Beat<E>) -> Result<(), E> {
        let highest: Vec<Candidate> = (0..BATCH).map_while(|_| self.heap.pop()).collect();
        let missing = highest.iter().map(|c| c.at).filter(|&at| self.slots[at].split.is_none());
        let batch = self.batch(missing);
        for (at, evaluation) in self.evaluate(&batch, beat)? {
            self.slots[at].split = evaluation.split;
        }
        let known = |c: &Candidate| self.slots[c.at].split.is_some() || !batch.contains(&c.at);
        self.heap.extend(highest.into_iter().filter(known));
        Ok(())
    }

    /// The first of `slots` that together have no more lights than the tensor, at least one: evaluation takes memory for each.
    fn batch(&self, slots: impl IntoIterator<Item = usize>) -> Vec<usize> {
        let mut lights = 0;
        let fits = |&(number, at): &(usize, usize)| {
            lights += self.slots[at].extent.len as usize;
            number == 0 || lights <= self.tensor.lights()
        };
        slots.into_iter().take(BATCH).enumerate().take_while(fits).map(|(_, at)| at).collect()
    }

    fn evaluate<E: Send>(
        &self,
        batch: &[usize],
        beat: &Beat<E>,
    ) -> Result<Vec<(usize, Evaluation)>, E> {
        let evaluate = |&at: &usize| {
            let slot = &self.slots[at];
            let mut random = random(self.settings.seed, Draw::Line, slot.node);
            let time_weight = self.settings.time_weight;
            let rectangle = rectangle(&self.history.lights, slot.extent);
            evaluate(self.tensor, &rectangle, slot.cost, &mut random, time_weight, beat)
                .map(|evaluation| (at, evaluation))
        };
        batch.par_iter().with_max_len(1).map(evaluate).collect()
    }

    fn apply(&mut self, at: usize, split: &Split) {
        let extent = self.slots[at].extent;
        let rectangle = rectangle(&self.history.lights, extent);
        let [(first_lights, first_frames), (second_lights, second_frames)] =
            parts(&rectangle, &split.cut);
        let mut first = extent;
        let second = match split.cut {
            Cut::Lights(_) => {
                let range = extent.start as usize..extent.end() as usize;
                let whole = &mut self.history.lights[range];
                let (to_first, to_second) = whole.split_at_mut(first_lights.len());
                to_first.copy_from_slice(&first_lights);
                to_second.copy_from_slice(&second_lights);
                first.len = first_lights.len() as u32;
                Extent { start: extent.start + first.len, len: extent.len - first.len, ..extent }
            }
            Cut::Time(_) => {
                first.last = first_frames.end as u32;
                self.append(&second_lights, &second_frames)
            }
        };
        let (kind, position) = match split.cut {
            Cut::Lights(_) => (Extent::LIGHTS, first.len),
            Cut::Time(frame) => (Extent::TIME, frame as u32),
        };
        self.history.splits.extend([at as u32, kind, position]);
        let new = self.slots.len();
        for (part, (at, extent)) in [(at, first), (new, second)].into_iter().enumerate() {
            let (cost, weight, node) = (split.costs[part], split.weights[part], self.nodes);
            self.nodes += 1;
            let slot = Slot { extent, node, cost: Some(cost), split: None };
            if at == new {
                self.slots.push(slot);
            } else {
                self.slots[at] = slot;
            }
            self.total.set(at, cost);
            self.heap.push(Candidate { cost, weight, node, at });
        }
        self.history.costs.push(self.total.get());
    }
}

fn rectangle(lights: &[u32], extent: Extent) -> Rectangle<'_> {
    Rectangle {
        lights: &lights[extent.start as usize..extent.end() as usize],
        frames: extent.first as usize..extent.last as usize,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::super::fixtures::{no_tick, noise, smooth, tensor_of};
    use super::*;

    fn settings(start: usize, limit: usize) -> Settings<'static> {
        Settings { start, limit, time_weight: 1.0, seed: 3, cuts: &[] }
    }

    #[test]
    fn a_change_in_time_is_split_in_time_and_two_kinds_of_light_in_lights() {
        let entry = |kind: bool, j: usize, i: usize| {
            (j + 1) as f32 * if kind == (i < 4) { 1.0 } else { 0.1 }
        };
        let change = tensor_of(30, 9, 8, |j, i, k| entry(k < 5, j, i));
        let history = cluster_tensor(&change, &settings(1, 2), &no_tick).unwrap();
        assert_eq!(history.splits, [0, Extent::TIME, 5]);
        assert_eq!(history.costs[1], 0.0);

        let kinds = tensor_of(30, 9, 8, |j, i, _| entry(j % 3 == 0, j, i));
        let history = cluster_tensor(&kinds, &settings(1, 2), &no_tick).unwrap();
        let clusters = history.cut(2).unwrap();
        let third = clusters.iter().find(|c| c.lights.len() == 10).unwrap();
        assert!(third.lights.iter().all(|j| j % 3 == 0));
        assert_eq!((third.first_frame, third.last_frame), (0, 8));
        assert_eq!(history.costs[1], 0.0);
    }

    #[test]
    fn the_weight_of_time_splits_shifts_the_balance() {
        let tensor = smooth(80, 12, 10);
        let splits_in_time = |time_weight| {
            let settings = Settings { time_weight, ..settings(1, 11) };
            let history = cluster_tensor(&tensor, &settings, &no_tick).unwrap();
            history.splits.chunks(3).filter(|split| split[1] == Extent::TIME).count()
        };
        // While every cluster has several lights and several frames, the weight alone can decide.
        assert_eq!(splits_in_time(1e9), 0);
        assert_eq!(splits_in_time(1e-9), 9);
        assert!((1..9).contains(&splits_in_time(0.9)), "{}", splits_in_time(0.9));
    }

    #[test]
    fn a_camera_cut_separates_two_independent_clusterings() {
        let shots = [smooth(50, 12, 3), tensor_of(50, 12, 4, noise)];
        let joined = tensor_of(50, 12, 7, |j, i, k| match k {
            0..3 => shots[0].column(j, k)[i],
            _ => shots[1].column(j, k - 3)[i],
        });
        let settings = Settings { cuts: &[3], ..settings(8, 16) };
        let history = cluster_tensor(&joined, &settings, &no_tick).unwrap();
        let first = Settings { cuts: &[], limit: 8, ..settings };
        let alone = cluster_tensor(&shots[0], &first, &no_tick).unwrap();
        let of_first = |clusters: Vec<super::super::Cluster>| {
            clusters
                .into_iter()
                .filter(|c| c.first_frame == 0)
                .map(|c| c.lights)
                .collect::<Vec<_>>()
        };
        let start = alone.min_count();
        assert_eq!(
            of_first(history.cut(history.min_count()).unwrap()),
            of_first(alone.cut(start).unwrap())
        );
        assert!(history.cut(16).unwrap().iter().all(|c| c.last_frame <= 3 || c.first_frame >= 3));
    }

    #[test]
    fn ticks_rise_and_an_error_stops_the_work() {
        let tensor = smooth(300, 12, 6);
        let seen = Mutex::new(Vec::new());
        let tick = |done, total| {
            assert_eq!(total, 200);
            seen.lock().unwrap().push(done);
            if done >= 90 { Err(Error::Damaged("stopped")) } else { Ok(()) }
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let error =
            pool.install(|| cluster_tensor(&tensor, &settings(20, 200), &tick)).unwrap_err();
        assert_eq!(error, Error::Damaged("stopped"));
        let seen = seen.into_inner().unwrap();
        assert!(
            seen.is_sorted()
                && seen[0] == 0
                && seen.iter().filter(|&&done| done >= 90).count() == 1
        );
    }
}
