//! Frames of a sequence: `####` or `%04d` in the name of a volume file stands for a number.
//!
//! A run of `#` is replaced by the number padded with zeros to the length of the run, `%0Nd` to N
//! digits, `%d` unpadded, as Houdini, Nuke and printf have it. Outputs get the number inserted
//! ahead of the extension, four digits at least: `smoke.exr` becomes `smoke.0012.exr`.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// What stands for the frame in a name, and its width.
struct Placeholder {
    start: usize,
    end: usize,
    digits: usize,
}

fn placeholder(name: &str) -> Option<Placeholder> {
    if let Some(start) = name.find('#') {
        let digits = name[start..].bytes().take_while(|b| *b == b'#').count();
        let end = start + digits;
        return Some(Placeholder { start, end, digits });
    }
    name.match_indices('%').find_map(|(start, _)| {
        let spec = &name[start + 1..];
        let length = spec.bytes().take_while(u8::is_ascii_digit).count();
        if spec.as_bytes().get(length) != Some(&b'd') {
            return None;
        }
        let digits = match &spec[..length] {
            "" => 1,
            width => width
                .strip_prefix('0')?
                .parse()
                .ok()
                .filter(|d| (1..=9).contains(d))?,
        };
        let end = start + length + 2;
        Some(Placeholder { start, end, digits })
    })
}

fn name_of(file: &Path) -> Option<&str> {
    file.file_name()?.to_str()
}

/// Does the name leave the frame open? A file that is there under that very name does not.
pub fn is_pattern(file: &Path) -> bool {
    name_of(file).and_then(placeholder).is_some() && !file.exists()
}

/// The file of a frame; the file itself if its name has no place for a number.
pub fn file_of(file: &Path, frame: u32) -> PathBuf {
    let Some(name) = name_of(file) else {
        return file.to_owned();
    };
    match placeholder(name) {
        Some(Placeholder { start, end, digits }) => {
            let (head, tail) = (&name[..start], &name[end..]);
            file.with_file_name(format!("{head}{frame:0digits$}{tail}"))
        }
        None => file.to_owned(),
    }
}

/// The output of a frame: the number in the place the name has for it, or ahead of the extension.
pub fn output_of(output: &Path, frame: u32) -> PathBuf {
    if name_of(output).and_then(placeholder).is_some() {
        return file_of(output, frame);
    }
    let mut name = output.file_stem().unwrap_or_default().to_owned();
    name.push(format!(".{frame:04}"));
    if let Some(extension) = output.extension() {
        name.push(".");
        name.push(extension);
    }
    output.with_file_name(name)
}

/// `7`, or `1-48`.
pub fn parse_range(text: &str) -> Result<RangeInclusive<u32>, String> {
    let number = |s: &str| {
        s.trim()
            .parse::<u32>()
            .map_err(|_| format!("`{s}` is no frame number; write a range as 1-48"))
    };
    let (first, last) = match text.split_once('-') {
        Some((first, last)) => (number(first)?, number(last)?),
        None => (number(text)?, number(text)?),
    };
    if first > last {
        return Err(format!(
            "the first frame, {first}, comes after the last, {last}"
        ));
    }
    Ok(first..=last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_take_their_place() {
        for (pattern, name) in [
            ("v/smoke.####.vdb", "v/smoke.0012.vdb"),
            ("smoke#.vdb", "smoke12.vdb"),
            ("smoke_%04d.vdb", "smoke_0012.vdb"),
            ("smoke_%d.vdb", "smoke_12.vdb"),
            ("50%_%03d.vdb", "50%_012.vdb"),
            ("v##/smoke.vdb", "v##/smoke.vdb"),
            ("smoke_%4d.vdb", "smoke_%4d.vdb"),
        ] {
            assert_eq!(file_of(Path::new(pattern), 12), Path::new(name));
        }
        assert!(is_pattern(Path::new("smoke.####.vdb")), "pattern");
        assert!(!is_pattern(Path::new("smoke.vdb")), "no pattern");
    }

    #[test]
    fn outputs_get_the_number() {
        for (output, name) in [
            ("out/smoke.exr", "out/smoke.0007.exr"),
            ("smoke", "smoke.0007"),
            ("smoke.##.exr", "smoke.07.exr"),
        ] {
            assert_eq!(output_of(Path::new(output), 7), Path::new(name));
        }
    }

    #[test]
    fn ranges() {
        assert_eq!(parse_range("1-48"), Ok(1..=48));
        assert_eq!(parse_range("7"), Ok(7..=7));
        for bad in ["", "a", "1-", "-3", "5-2", "1-2-3"] {
            assert!(parse_range(bad).is_err(), "{bad}");
        }
    }
}
