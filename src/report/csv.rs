//! The table of settings as comma-separated values (RFC 4180).

use super::{Document, Fate, Spread};

/// The settings of `document`, a row each, under one row of headings; lines end in CR LF.
///
/// The columns are the value of each axis (RON text), then mean, standard deviation and number of
/// values of each figure, of the evaluations and of the processor seconds, the two marks (`together`,
/// `other_host`), the two fronts, and how many of the setting's points are done, failed and missing.
/// What is not known, or not finite, is an empty field.
pub fn csv(document: &Document) -> String {
    let spread = |name: &str| ["mean", "sd", "count"].map(|part| format!("{name} {part}"));
    let mut headings: Vec<String> = document.axes.iter().map(|axis| axis.name.clone()).collect();
    headings.extend(document.figures.iter().flat_map(|figure| spread(figure)));
    headings.extend(["evaluations", "cpu_seconds"].into_iter().flat_map(spread));
    let last = ["together", "other_host", "front_evaluations", "front_cpu_seconds"];
    headings.extend(last.into_iter().chain(["done", "failed", "missing"]).map(str::to_owned));
    let mut text = line(headings);
    for setting in &document.settings {
        let mut fields = setting.values.clone();
        fields.resize(document.axes.len(), String::new());
        for figure in &document.figures {
            fields.extend(numbers(setting.figures.get(figure)));
        }
        fields.extend(numbers(setting.evaluations.as_ref()));
        fields.extend(numbers(setting.cpu_seconds.as_ref()));
        let marks = [setting.together, setting.other_host];
        let fronts = [setting.front_evaluations, setting.front_cpu_seconds];
        fields.extend(marks.into_iter().chain(fronts).map(|flag| flag.to_string()));
        let points = || setting.points.iter().filter_map(|point| document.points.get(*point));
        let count = |fate| points().filter(|point| point.fate == fate).count().to_string();
        fields.extend([Fate::Done, Fate::Failed, Fate::Missing].map(count));
        text += &line(fields);
    }
    text
}

fn numbers(spread: Option<&Spread>) -> [String; 3] {
    spread.map_or_else(Default::default, |s| {
        [number(s.mean), number(s.deviation), s.count.to_string()]
    })
}

/// All digits of a number, without a long tail of zeros.
fn number(value: f64) -> String {
    match value.abs() {
        size if !size.is_finite() => String::new(),
        size if size != 0.0 && !(1e-5..1e16).contains(&size) => format!("{value:e}"),
        _ => format!("{value}"),
    }
}

fn line(fields: Vec<String>) -> String {
    let quoted = |field: String| {
        if field.contains([',', '"', '\r', '\n']) {
            format!("\"{}\"", field.replace('"', "\"\""))
        } else {
            field
        }
    };
    fields.into_iter().map(quoted).collect::<Vec<_>>().join(",") + "\r\n"
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Point, Setting};
    use super::*;

    #[test]
    fn a_row_has_what_is_known_of_its_setting() {
        let spread = |mean| Spread { mean, deviation: 2.5e-7, count: 2 };
        let document = Document {
            axes: vec![Axis { name: "size".to_owned(), values: vec![] }],
            figures: vec!["error.rmse".to_owned(), "error.\"flip\"".to_owned()],
            settings: vec![
                Setting {
                    values: vec!["(320, 180)".to_owned()],
                    points: vec![0, 1, 9],
                    figures: [("error.rmse".to_owned(), spread(0.125))].into(),
                    evaluations: Some(spread(1200.0)),
                    together: true,
                    front_evaluations: true,
                    ..Setting::default()
                },
                Setting::default(),
            ],
            points: vec![
                Point { fate: Fate::Done, ..Point::default() },
                Point { fate: Fate::Failed, ..Point::default() },
            ],
            ..Document::default()
        };
        let text = csv(&document);
        let lines: Vec<&str> = text.split_terminator("\r\n").collect();
        assert_eq!(
            lines[0],
            "size,error.rmse mean,error.rmse sd,error.rmse count,\"error.\"\"flip\"\" mean\",\
             \"error.\"\"flip\"\" sd\",\"error.\"\"flip\"\" count\",evaluations mean,evaluations sd,\
             evaluations count,cpu_seconds mean,cpu_seconds sd,cpu_seconds count,together,other_host,\
             front_evaluations,front_cpu_seconds,done,failed,missing"
        );
        assert_eq!(
            lines[1],
            "\"(320, 180)\",0.125,2.5e-7,2,,,,1200,2.5e-7,2,,,,true,false,true,false,1,1,0"
        );
        assert_eq!(lines[2], ",,,,,,,,,,,,,false,false,false,false,0,0,0");
        assert_eq!(lines.len(), 3);
    }

    #[test]
    fn numbers_keep_their_value() {
        for value in [0.0, -0.1, 1e-300, 123456.789, 1e17, 1.0 / 3.0] {
            assert_eq!(number(value).parse::<f64>().unwrap(), value);
        }
        assert_eq!([number(f64::NAN), number(f64::INFINITY)], ["", ""]);
    }
}
