//! The best split of one cluster, in time or in lights (Hašan 2008, section 4.3.2).

use rand_pcg::Pcg64Mcg;

use super::cost::{self, Rectangle};
use super::sweep::{Position, Sums, Weights, best};
use super::{Beat, Tensor, lanes, line};

/// Where a cluster divides.
#[derive(Debug, Clone, PartialEq)]
pub enum Cut {
    /// For each light of the cluster, whether it goes to the second part.
    Lights(Vec<bool>),
    /// The first frame of the second part.
    Time(usize),
}

/// A cut with the weights W and the costs of the two parts; both have weight.
#[derive(Debug, Clone)]
pub struct Split {
    pub cut: Cut,
    pub weights: [f64; 2],
    pub costs: [f64; 2],
}

/// The weight and the cost of a cluster and its best split; none if only one light-frame pair has weight.
pub struct Evaluation {
    pub weight: f64,
    pub cost: f64,
    pub split: Option<Split>,
}

/// Finds the best split. `cost` is the cluster's cost if it is known. `random` draws the two lights whose line orders the lights.
/// The cost after a split in time is multiplied by `time_weight` when it is compared with that after a split in lights.
/// A cluster of cost zero is halved by weight instead: there every cut is as good as another.
pub fn evaluate<E>(
    tensor: &Tensor,
    rectangle: &Rectangle,
    cost: Option<f64>,
    random: &mut Pcg64Mcg,
    time_weight: f64,
    beat: &Beat<E>,
) -> Result<Evaluation, E> {
    let weights = Weights::of(tensor, rectangle);
    let weight = weights.frames.iter().sum();
    if cost == Some(0.0) {
        return Ok(Evaluation { weight, cost: 0.0, split: halve(rectangle, &weights) });
    }
    let direction = line::direction(tensor, rectangle, &weights.lights, random, beat)?;
    let sums = Sums::of(tensor, rectangle, &direction, beat)?;
    let cost = match cost {
        Some(cost) => cost,
        None => total_cost(tensor, rectangle, weight, &sums, beat)?,
    };
    if cost == 0.0 {
        return Ok(Evaluation { weight, cost, split: halve(rectangle, &weights) });
    }
    let order = sums.order(&weights.lights);
    let by_light = best_in_lights(tensor, rectangle, &weights, &sums, &order, beat)?;
    let by_time = best_in_time(tensor, rectangle, &weights, &sums, beat)?;
    let (cut, position) = match (by_light, by_time) {
        // At equal cost the lights are split: a split in time can be seen as a jump.
        (Some(light), Some(time)) if time.cost() * time_weight >= light.cost() => {
            (in_lights(&order, light.at), light)
        }
        (_, Some(time)) => (Cut::Time(rectangle.frames.start + time.at), time),
        (Some(light), None) => (in_lights(&order, light.at), light),
        (None, None) => return Ok(Evaluation { weight, cost, split: None }),
    };
    let mut split = Split { cut, weights: position.weights, costs: position.costs };
    let parts = parts(rectangle, &split.cut);
    for (part, (lights, frames)) in parts.into_iter().enumerate() {
        let part_of = Rectangle { lights: &lights, frames };
        split.costs[part] =
            cost::refined(split.costs[part], split.weights[part], tensor, &part_of, beat)?;
    }
    Ok(Evaluation { weight, cost, split: Some(split) })
}

fn total_cost<E>(
    tensor: &Tensor,
    rectangle: &Rectangle,
    weight: f64,
    sums: &Sums,
    beat: &Beat<E>,
) -> Result<f64, E> {
    let sum = if sums.frames.is_empty() {
        cost::sum(tensor, rectangle, beat)?
    } else {
        let mut sum = vec![0.0; tensor.rows()];
        sums.frames.chunks(tensor.rows()).for_each(|frame| lanes::add(&mut sum, frame));
        sum
    };
    let norm = sum.iter().map(|x| x * x).sum();
    cost::refined(cost::plain(weight, norm), weight, tensor, rectangle, beat)
}

fn best_in_lights<E>(
    tensor: &Tensor,
    rectangle: &Rectangle,
    weights: &Weights,
    sums: &Sums,
    order: &[u32],
    beat: &Beat<E>,
) -> Result<Option<Position>, E> {
    let rows = tensor.rows();
    let weights: Vec<f64> = order.iter().map(|&at| weights.lights[at as usize]).collect();
    if sums.lights.is_empty() {
        let light = |at: usize| rectangle.lights[order[at] as usize] as usize;
        best(&weights, rows, |at| tensor.column(light(at), rectangle.frames.start), beat)
    } else {
        best(&weights, rows, |at| &sums.lights[order[at] as usize * rows..][..rows], beat)
    }
}

fn best_in_time<E>(
    tensor: &Tensor,
    rectangle: &Rectangle,
    weights: &Weights,
    sums: &Sums,
    beat: &Beat<E>,
) -> Result<Option<Position>, E> {
    let rows = tensor.rows();
    if sums.frames.is_empty() {
        let slab = tensor.slab(rectangle.lights[0] as usize, rectangle.frames.clone());
        best(&weights.frames, rows, |k| &slab[k * rows..][..rows], beat)
    } else {
        best(&weights.frames, rows, |k| &sums.frames[k * rows..][..rows], beat)
    }
}

fn in_lights(order: &[u32], at: usize) -> Cut {
    let mut second = vec![false; order.len()];
    order[at..].iter().for_each(|&light| second[light as usize] = true);
    Cut::Lights(second)
}

/// The lights, ascending, and the frames of the two parts.
pub fn parts(rectangle: &Rectangle, cut: &Cut) -> [(Vec<u32>, std::ops::Range<usize>); 2] {
    let Rectangle { lights, frames } = rectangle.clone();
    match cut {
        Cut::Time(at) => [(lights.to_vec(), frames.start..*at), (lights.to_vec(), *at..frames.end)],
        Cut::Lights(second) => [false, true].map(|side| {
            let here = lights.iter().zip(second).filter(|&(_, &second)| second == side);
            (here.map(|(&light, _)| light).collect(), frames.clone())
        }),
    }
}

/// The cut nearest to half the weight: between lights if two of them have weight, else between frames.
fn halve(rectangle: &Rectangle, weights: &Weights) -> Option<Split> {
    let half = |weights: &[f64]| {
        let last = weights.iter().rposition(|&w| w > 0.0)?;
        let total: f64 = weights.iter().sum();
        let mut best: Option<(usize, f64)> = None;
        let mut first = 0.0;
        for at in 1..=last {
            first += weights[at - 1];
            let off = |first: f64| (total - 2.0 * first).abs();
            if first > 0.0 && best.is_none_or(|(_, best)| off(first) < off(best)) {
                best = Some((at, first));
            }
        }
        best.map(|(at, first)| (at, [first, weights[at..].iter().sum()]))
    };
    let (cut, weights) = match half(&weights.lights) {
        Some((at, sides)) => {
            (Cut::Lights((0..rectangle.lights.len()).map(|light| light >= at).collect()), sides)
        }
        None => {
            let (at, sides) = half(&weights.frames)?;
            (Cut::Time(rectangle.frames.start + at), sides)
        }
    };
    Some(Split { cut, weights, costs: [0.0; 2] })
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{never, smooth, tensor_of};
    use super::super::{Draw, random};
    use super::*;

    #[test]
    fn with_the_same_two_lights_the_order_of_the_lights_does_not_count() {
        const N: usize = 90;
        let tensor = smooth(N, 13, 4);
        let to = |light: usize| light * 37 % N;
        let permuted = tensor_of(N, 13, 4, |j, i, k| {
            tensor.column((0..N).find(|&l| to(l) == j).unwrap(), k)[i]
        });
        let lights: Vec<u32> = (0..N as u32).collect();
        let split = |tensor: &Tensor, first: usize, second: usize| {
            let all = Rectangle { lights: &lights, frames: 0..4 };
            let direction = line::through(tensor, &all, first, second)?;
            let sums = Sums::of(tensor, &all, &direction, &never).unwrap();
            let weights = Weights::of(tensor, &all);
            let order = sums.order(&weights.lights);
            let best = best_in_lights(tensor, &all, &weights, &sums, &order, &never).unwrap()?;
            let Cut::Lights(second) = in_lights(&order, best.at) else { return None };
            Some(second)
        };
        let mut compared = 0;
        for first in 0..20 {
            let second = first + 31;
            let (Some(a), Some(b)) =
                (split(&tensor, first, second), split(&permuted, to(first), to(second)))
            else {
                continue;
            };
            // Lights without weight are equal in place and weight: their numbers decide.
            let weights = Weights::of(&tensor, &Rectangle { lights: &lights, frames: 0..4 }).lights;
            let lit = (0..N).filter(|&light| weights[light] > 0.0);
            assert!(
                lit.clone().all(|light| a[light] == b[to(light)]),
                "lights {first} and {second}"
            );
            compared += 1;
        }
        assert!(compared > 10);
    }

    #[test]
    fn the_children_carry_their_own_weights_and_costs() {
        let tensor = smooth(60, 13, 6);
        let lights: Vec<u32> = (0..60).filter(|j| j % 3 != 1).collect();
        for frames in [0..6, 2..4, 3..4] {
            let rectangle = Rectangle { lights: &lights, frames };
            let mut random = random(1, Draw::Line, 0);
            let Evaluation { weight, cost, split } =
                evaluate(&tensor, &rectangle, None, &mut random, 1.0, &never).unwrap();
            let split = split.unwrap();
            assert!((split.weights[0] + split.weights[1] - weight).abs() < 1e-12 * weight);
            assert!(split.costs[0] + split.costs[1] < cost);
            for (part, (lights, frames)) in parts(&rectangle, &split.cut).into_iter().enumerate() {
                let part_of = Rectangle { lights: &lights, frames };
                let own: f64 = Weights::of(&tensor, &part_of).lights.iter().sum();
                let sum = cost::sum(&tensor, &part_of, &never).unwrap();
                let own_cost = own * own - sum.iter().map(|x| x * x).sum::<f64>();
                assert!((split.weights[part] - own).abs() < 1e-12 * own);
                assert!((split.costs[part] - own_cost).abs() < 1e-12 * own * own);
            }
        }
    }

    #[test]
    fn a_cluster_of_no_cost_is_halved() {
        let tensor =
            tensor_of(9, 2, 3, |j, i, k| if j == 4 || k == 2 { 0.0 } else { (1 + i) as f32 });
        let lights: Vec<u32> = (0..9).collect();
        let halved = |lights, frames| {
            let rectangle = Rectangle { lights, frames };
            let mut random = random(1, Draw::Line, 0);
            evaluate(&tensor, &rectangle, Some(0.0), &mut random, 1.0, &never).unwrap().split
        };
        let split = halved(&lights, 0..3).unwrap();
        assert_eq!(split.cut, Cut::Lights((0..9).map(|j| j >= 4).collect()));
        assert_eq!((split.weights[0], split.costs), (split.weights[1], [0.0; 2]));
        assert_eq!(halved(&lights[..1], 0..3).unwrap().cut, Cut::Time(1));
        assert!(halved(&lights[..1], 1..3).is_none());
        assert!(halved(&lights[4..5], 0..2).is_none());
    }
}
