//! Settings compared: means over seeds, the Pareto front, and the cheapest that meet a target.

use crate::report::{Cheapest, Document, Fate, Point, Setting, Spread};
use std::collections::BTreeSet;

/// Relative errors for which the cheapest setting is told.
const TARGETS: [f64; 3] = [0.05, 0.02, 0.01];

/// Fills in what follows from the points of a document: its settings, their front in the plotted
/// figure, and the cheapest. `values` are the axes' values of each setting.
pub fn summarize(document: &mut Document, values: Vec<Vec<String>>) {
    let points = &document.points;
    let setting = |(number, values): (usize, Vec<String>)| {
        let own: Vec<usize> = (0..points.len()).filter(|&p| points[p].setting == number).collect();
        let done: Vec<&Point> =
            own.iter().map(|&p| &points[p]).filter(|p| p.fate == Fate::Done).collect();
        let names: BTreeSet<&String> = done.iter().flat_map(|p| p.figures.keys()).collect();
        let figure = |name: &String| {
            let values: Vec<f64> =
                done.iter().filter_map(|p| p.figures.get(name).copied()).collect();
            Some((name.clone(), spread(&values)?))
        };
        let evaluations: Vec<f64> =
            done.iter().filter_map(|p| Some(p.evaluations? as f64)).collect();
        let cpu_seconds: Vec<f64> = done.iter().filter_map(|p| p.cpu_seconds).collect();
        Setting {
            values,
            figures: names.into_iter().filter_map(figure).collect(),
            evaluations: spread(&evaluations),
            cpu_seconds: spread(&cpu_seconds),
            together: done.iter().any(|p| p.together),
            other_host: done.iter().any(|p| p.other_host),
            points: own,
            ..Setting::default()
        }
    };
    let mut settings: Vec<Setting> = values.into_iter().enumerate().map(setting).collect();
    let y = &document.plot.y;
    let place = |cost: fn(&Setting) -> Option<Spread>| -> Vec<Option<(f64, f64)>> {
        settings.iter().map(|s| Some((cost(s)?.mean, s.figures.get(y)?.mean))).collect()
    };
    let (by_evaluations, by_seconds) = (place(|s| s.evaluations), place(|s| s.cpu_seconds));
    for (k, setting) in settings.iter_mut().enumerate() {
        setting.front_evaluations = on_front(&by_evaluations, k);
        setting.front_cpu_seconds = on_front(&by_seconds, k);
    }
    let cheapest = |target| Cheapest {
        target,
        evaluations: cheapest(&by_evaluations, target),
        cpu_seconds: cheapest(&by_seconds, target),
    };
    document.cheapest = TARGETS.map(cheapest).to_vec();
    document.settings = settings;
}

/// Mean and sample standard deviation; none of nothing.
fn spread(values: &[f64]) -> Option<Spread> {
    let count = values.len();
    let mean = (count > 0).then(|| values.iter().sum::<f64>() / count as f64)?;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    let deviation = (squares / count.saturating_sub(1).max(1) as f64).sqrt();
    Some(Spread { mean, deviation, count })
}

/// Whether no other place is as good in both and better in one. Places are (cost, error).
fn on_front(places: &[Option<(f64, f64)>], k: usize) -> bool {
    let Some((cost, error)) = places[k] else { return false };
    let beats = |&(c, e): &(f64, f64)| c <= cost && e <= error && (c < cost || e < error);
    !places.iter().flatten().any(beats)
}

/// The place of least cost whose error is at most `target`; of equals, the one of less error, then the first.
fn cheapest(places: &[Option<(f64, f64)>], target: f64) -> Option<usize> {
    let within = places.iter().enumerate().filter_map(|(k, p)| Some((k, (*p)?)));
    let order = |(cost, error): (f64, f64), (c, e): (f64, f64)| {
        cost.total_cmp(&c).then(error.total_cmp(&e))
    };
    within.filter(|(_, (_, error))| *error <= target).min_by(|a, b| order(a.1, b.1)).map(|(k, _)| k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Plot;
    use std::collections::BTreeMap;

    fn document(points: &[(usize, u64, f64, Fate)]) -> Document {
        let point = |&(setting, evaluations, error, fate): &(usize, u64, f64, Fate)| Point {
            setting,
            fate,
            figures: BTreeMap::from([("e".to_owned(), error)]),
            evaluations: Some(evaluations),
            cpu_seconds: Some(evaluations as f64 * 0.5),
            ..Point::default()
        };
        let plot = Plot { y: "e".into(), ..Plot::default() };
        let mut document =
            Document { points: points.iter().map(point).collect(), plot, ..Document::default() };
        let count = points.iter().map(|p| p.0 + 1).max().unwrap_or(0);
        summarize(&mut document, (0..count).map(|k| vec![k.to_string()]).collect());
        document
    }

    #[test]
    fn seeds_are_averaged_and_failed_points_left_out() {
        let all = document(&[
            (0, 10, 1.0, Fate::Done),
            (0, 10, 3.0, Fate::Done),
            (0, 10, 9.0, Fate::Failed),
            (1, 20, 0.5, Fate::Missing),
        ]);
        let first = &all.settings[0];
        assert_eq!(first.figures["e"], Spread { mean: 2.0, deviation: 2.0_f64.sqrt(), count: 2 });
        assert_eq!(first.points, [0, 1, 2]);
        assert!(all.settings[1].figures.is_empty() && !all.settings[1].front_evaluations);
    }

    #[test]
    fn the_front_and_the_cheapest_are_the_known_ones() {
        let all = document(&[
            (0, 10, 0.10, Fate::Done),
            (1, 20, 0.04, Fate::Done),
            (2, 30, 0.05, Fate::Done),
            (3, 40, 0.015, Fate::Done),
            (4, 40, 0.015, Fate::Done),
            (5, 90, 0.012, Fate::Done),
        ]);
        let front: Vec<bool> = all.settings.iter().map(|s| s.front_evaluations).collect();
        assert_eq!(front, [true, true, false, true, true, true]);
        let found: Vec<Option<usize>> = all.cheapest.iter().map(|c| c.evaluations).collect();
        assert_eq!(found, [Some(1), Some(3), None]);
    }
}
