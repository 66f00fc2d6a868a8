//! Pictures and text as they go into a page: PNG in memory, base 64 (RFC 4648), HTML.

use super::StudyError;
use super::store::Pixels;
use crate::image::{self, Picture};
use crate::tone;

/// A picture for `compare`.
pub(super) fn picture(pixels: &Pixels, [width, height]: [u32; 2]) -> Picture {
    Picture {
        width,
        height,
        origin: [0; 2],
        rgb: pixels.clone(),
        standard_error: None,
    }
}

/// Tone-mapped PNG. `exposure` in stops.
pub(super) fn toned(p: &Picture, exposure: f64) -> Result<Vec<u8>, StudyError> {
    let bytes: Vec<u8> = p
        .rgb
        .iter()
        .enumerate()
        .flat_map(|(i, rgb)| {
            let (x, y) = (i as u32 % p.width, i as u32 / p.width);
            let v = tone::map(rgb.map(f64::from), exposure);
            [0, 1, 2].map(|c| tone::quantise(v[c as usize], x, y, c))
        })
        .collect();
    png(p.width, p.height, &bytes)
}

/// PNG of rows of red, green, blue bytes.
pub(super) fn png(width: u32, height: u32, bytes: &[u8]) -> Result<Vec<u8>, StudyError> {
    let mut out = Vec::new();
    image::encode_png(&mut out, width, height, bytes).map_err(|e| StudyError::Plot {
        name: "a picture".to_owned(),
        reason: e.to_string(),
    })?;
    Ok(out)
}

/// `data:` address of a PNG.
pub(super) fn data_uri(png: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::from("data:image/png;base64,");
    for three in png.chunks(3) {
        let byte = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i) & 63) as usize] as char;
            text.push(if i <= three.len() { digit } else { '=' });
        }
    }
    text
}

/// Text inside HTML.
pub(super) fn html(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648, section 10.
    #[test]
    fn base_64_is_that_of_the_standard() {
        for (bytes, text) in [
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ] {
            let uri = data_uri(bytes.as_bytes());
            assert_eq!(uri, format!("data:image/png;base64,{text}"), "{bytes}");
        }
    }
}
