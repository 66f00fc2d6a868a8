//! Numbers for people: four digits, thousands apart, sizes with units, histograms as bars.

use crate::vdb::Statistics;

pub(super) fn range(s: &Statistics) -> String {
    if s.active_voxels == s.not_finite {
        return "none".to_owned();
    }
    let low = s.components.iter().fold(f64::INFINITY, |m, c| m.min(c.min));
    let high = s
        .components
        .iter()
        .fold(f64::NEG_INFINITY, |m, c| m.max(c.max));
    if low == high {
        short(low)
    } else {
        format!("{} to {}", short(low), short(high))
    }
}

/// A bar for each step between the extremes; its height goes with the fourth root of the count,
/// so that rare values are seen beside common ones.
pub(super) fn bars(s: &Statistics, n: usize) -> String {
    const BARS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let (Some(low), Some(high)) = (s.histogram.percentile(0.0), s.histogram.percentile(1.0)) else {
        return String::new();
    };
    if low >= high {
        return String::new();
    }
    let counts = s.histogram.bars(low, high, n);
    let most = counts.iter().max().copied().unwrap_or(1) as f64;
    counts
        .iter()
        .map(|&c| BARS[((c as f64 / most).powf(0.25) * 8.0).ceil() as usize])
        .collect()
}

/// Four significant digits.
pub(super) fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let size = v.abs();
    if !(1e-4..1e6).contains(&size) {
        return format!("{v:.3e}");
    }
    let decimals = (3 - size.log10().floor() as i32).max(0) as usize;
    let text = format!("{v:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

pub(super) fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(d);
    }
    text
}

pub(super) fn bytes(n: usize) -> String {
    const UNITS: [&str; 4] = ["kB", "MB", "GB", "TB"];
    let mut size = n as f64;
    if n < 1000 {
        return format!("{n} B");
    }
    let mut unit = 0;
    size /= 1000.0;
    while size >= 999.95 && unit + 1 < UNITS.len() {
        size /= 1000.0;
        unit += 1;
    }
    format!("{size:.1} {}", UNITS[unit])
}

#[cfg(test)]
mod tests {
    use super::{bytes, short, thousands};

    #[test]
    fn numbers_are_short() {
        assert_eq!(short(0.453_616), "0.4536");
        assert_eq!(short(-12.0), "-12");
        assert_eq!(short(5.714_84), "5.715");
        assert_eq!(short(1e-7), "1.000e-7");
        assert_eq!(short(123_456.0), "123456");
        assert_eq!(thousands(1_049_275), "1,049,275");
        assert_eq!(bytes(999_960), "1.0 MB");
    }
}
