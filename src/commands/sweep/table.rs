//! The results of a sweep as text: settings by cost, and the cheapest that meet each target.

use crate::commands::figures;
use crate::report::{Document, Fate, Setting, Spread};
use crate::sweep::node_of;
use std::fmt::Write as _;

/// Figures of the plotted one's node beside it.
const MORE: usize = 3;

/// The table of `document`; with many settings, only those on the front.
pub fn table(document: &Document) -> String {
    const MOST: usize = 40;
    let y = &document.plot.y;
    let (own, others): (Vec<&String>, Vec<&String>) =
        document.figures.iter().filter(|f| *f != y).partition(|f| node_of(f) == node_of(y));
    let mut shown: Vec<&String> = document.figures.iter().filter(|f| *f == y).collect();
    shown.extend(own.into_iter().take(MORE));
    for other in others {
        // Of another node, its first.
        if shown.iter().all(|f| node_of(f) != node_of(other)) {
            shown.push(other);
        }
    }
    let mut settings: Vec<&Setting> =
        document.settings.iter().filter(|s| !s.figures.is_empty()).collect();
    if settings.len() > MOST {
        settings.retain(|s| s.front_evaluations || s.front_cpu_seconds);
    }
    let cost = |s: &Setting| s.evaluations.map_or(f64::INFINITY, |e| e.mean);
    settings.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let mut head: Vec<String> = document.axes.iter().map(|axis| axis.name.clone()).collect();
    head.extend(["evaluations".into(), "cpu".into()]);
    head.extend(shown.iter().map(|f| f.rsplit('.').next().unwrap_or(f).to_owned()));
    head.push(String::new());
    let rows = settings.iter().map(|s| row(s, &shown));
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(rows).collect();
    let mut out = aligned(&rows);
    if settings.iter().any(|s| s.together || s.other_host) {
        out += "  * times of a pass that served several settings, ran beside others, or on another host\n";
    }
    for point in document.points.iter().filter(|p| p.fate == Fate::Failed) {
        let values = document.settings.get(point.setting).map_or(&[][..], |s| &s.values);
        let (values, problem) = (values.join(" "), point.problem.as_deref().unwrap_or("unknown"));
        let _ = writeln!(out, "  failed: {values}: {problem}");
    }
    out + &cheapest(document)
}

fn row(setting: &Setting, shown: &[&String]) -> Vec<String> {
    let mut row = setting.values.clone();
    row.push(setting.evaluations.map_or("?".into(), |e| count(e.mean)));
    let mark = if setting.together || setting.other_host { "*" } else { "" };
    let seconds = |s: Spread| figures::duration(s.mean) + mark;
    row.push(setting.cpu_seconds.map_or("?".into(), seconds));
    row.extend(shown.iter().map(|f| setting.figures.get(*f).map_or("?".into(), figure)));
    let front = setting.front_evaluations || setting.front_cpu_seconds;
    row.push(if front { "front".into() } else { String::new() });
    row
}

/// `0.0412`, or `0.0412 +- 0.0021` over several seeds.
fn figure(spread: &Spread) -> String {
    match spread.count {
        0 | 1 => short(spread.mean),
        _ => format!("{} +- {}", short(spread.mean), rough(spread.deviation)),
    }
}

/// Two significant digits.
fn rough(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        v if (0.0001..100.0).contains(&v) => {
            format!("{value:.*}", (1 - v.log10().floor() as i32).clamp(0, 6) as usize)
        }
        _ => format!("{value:.1e}"),
    }
}

/// Four significant digits.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        v if (0.001..10_000.0).contains(&v) => {
            format!("{value:.*}", (3 - v.log10().floor() as i32).clamp(0, 6) as usize)
        }
        _ => format!("{value:.3e}"),
    }
}

/// `12.3 M`.
fn count(value: f64) -> String {
    let units = [(1e12, " T"), (1e9, " G"), (1e6, " M"), (1e3, " k")];
    let unit = units.iter().find(|(size, _)| value >= *size);
    unit.map_or(format!("{value:.0}"), |(size, name)| format!("{:.1}{name}", value / size))
}

/// Columns as wide as their widest entry, numbers to the right.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|v| v.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|c| width(c).unwrap_or(0)).collect();
    let mut out = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).map(|(v, width)| format!("{v:>width$}"));
        let line = cells.collect::<Vec<_>>().join("  ");
        let _ = writeln!(out, "  {}", line.trim_end());
    }
    out
}

/// The cheapest setting that meets each target, by what the sweep is plotted against.
fn cheapest(document: &Document) -> String {
    let mut out = String::new();
    for cheapest in &document.cheapest {
        let target = format!("{} % of {}", cheapest.target * 100.0, document.plot.y);
        let by_time = document.plot.x == "cpu_seconds";
        let best = if by_time { cheapest.cpu_seconds } else { cheapest.evaluations };
        let Some(setting) = best.and_then(|k| document.settings.get(k)) else {
            let _ = writeln!(out, "cheapest within {target}: not reached");
            continue;
        };
        let names = document.axes.iter().map(|axis| &axis.name).zip(&setting.values);
        let values: Vec<String> = names.map(|(name, value)| format!("{name}={value}")).collect();
        let evaluations = setting.evaluations.map_or("?".into(), |e| count(e.mean));
        let seconds = setting.cpu_seconds.map_or("?".into(), |s| figures::duration(s.mean));
        let values = values.join(" ");
        let _ = writeln!(
            out,
            "cheapest within {target}: {values}, {evaluations} evaluations, {seconds} of processor time"
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let told = [0.0, 0.041_23, 123.456, 12_345.6, 1e-9, -2.5].map(short);
        assert_eq!(told, ["0", "0.04123", "123.5", "1.235e4", "1.000e-9", "-2.500"]);
        assert_eq!([999.0, 12_345.0, 6.5e8].map(count), ["999", "12.3 k", "650.0 M"]);
    }
}
