//! How sizes, durations and moments are written for people.

/// Bytes in powers of a thousand with three digits: `1.02 GB`.
pub fn bytes(count: u64) -> String {
    if count < 1000 {
        return format!("{count} bytes");
    }
    let (mut value, mut unit) = (count as f64 / 1000.0, "kB");
    for larger in ["MB", "GB", "TB", "PB", "EB"] {
        if value >= 999.5 {
            (value, unit) = (value / 1000.0, larger);
        }
    }
    let decimals = match value {
        v if v < 9.995 => 2,
        v if v < 99.95 => 1,
        _ => 0,
    };
    format!("{value:.decimals$} {unit}")
}

/// Seconds as a person would say them: `414 ms`, `41.2 s`, `6 min 10 s`, `1 h 50 min`, `3 d 4 h`.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s.is_nan() || s <= 0.0 => "0 s".into(),
        s if s < 0.9995 => format!("{:.0} ms", s * 1000.0),
        s if s < 9.995 => format!("{s:.2} s"),
        s if s < 59.95 => format!("{s:.1} s"),
        s if s < 3599.5 => pair(s, 1, "min", "s"),
        s if s < 86_370.0 => pair(s, 60, "h", "min"),
        s => {
            let hours = (s / 3600.0).round() as u64;
            format!("{} d {} h", hours / 24, hours % 24)
        }
    }
}

/// Seconds in a unit of `60 * small` seconds and one of `small` seconds.
fn pair(seconds: f64, small: u64, large_unit: &str, small_unit: &str) -> String {
    let count = (seconds / small as f64).round() as u64;
    format!("{} {large_unit} {} {small_unit}", count / 60, count % 60)
}

/// A moment given in seconds since 1970, to the minute: `2026-11-21 14:02 UTC`.
pub fn moment(since_1970: u64) -> String {
    /// Days of 400 years: the calendar repeats after them.
    const CYCLE: u64 = 146_097;
    let days = since_1970 / 86_400;
    let (mut year, mut day) = (1970 + days / CYCLE * 400, days % CYCLE);
    let in_fours = |n: u64| n.is_multiple_of(4);
    // Years that end a century count by the century.
    let leap =
        |year: u64| u64::from(in_fours(if year.is_multiple_of(100) { year / 100 } else { year }));
    while day >= 365 + leap(year) {
        day -= 365 + leap(year);
        year += 1;
    }
    let mut month = 0;
    let lengths = [31, 28 + leap(year), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    while day >= lengths[month] {
        day -= lengths[month];
        month += 1;
    }
    let (hour, minute) = (since_1970 / 3600 % 24, since_1970 / 60 % 60);
    format!("{year}-{:02}-{:02} {hour:02}:{minute:02} UTC", month + 1, day + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_three_digits() {
        let told = [0, 999, 1000, 9_994, 999_499, 999_500, 1_020_000_000, u64::MAX].map(bytes);
        let expected = [
            "0 bytes",
            "999 bytes",
            "1.00 kB",
            "9.99 kB",
            "999 kB",
            "1.00 MB",
            "1.02 GB",
            "18.4 EB",
        ];
        assert_eq!(told, expected);
    }

    #[test]
    fn durations_carry_over() {
        let told = [f64::NAN, 0.414, 9.999, 59.99, 370.0, 3599.7, 6600.0, 86_399.0, 273_600.0];
        let expected = [
            "0 s",
            "414 ms",
            "10.0 s",
            "1 min 0 s",
            "6 min 10 s",
            "1 h 0 min",
            "1 h 50 min",
            "1 d 0 h",
            "3 d 4 h",
        ];
        assert_eq!(told.map(duration), expected);
    }

    #[test]
    fn moments_know_leap_years() {
        assert_eq!(moment(0), "1970-01-01 00:00 UTC");
        assert_eq!(moment(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(moment(1_795_269_779), "2026-11-21 14:02 UTC");
        assert_eq!(moment(4_107_542_399), "2100-02-28 23:59 UTC");
        assert_eq!(moment(4_107_542_400), "2100-03-01 00:00 UTC");
        assert!(moment(u64::MAX).ends_with("UTC"));
    }
}
