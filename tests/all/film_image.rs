//! The film against known distributions; pictures written and read back; files whole or absent.

use std::fs;
use std::path::Path;

use glam::DVec3;
use vpm_vdb::atomic::{check_writable, write_bytes};
use vpm_vdb::film::{Film, FilmBytesError, Sample, luminance};
use vpm_vdb::image::{Metadata, read_exr, write_exr, write_png};
use vpm_vdb::report::ImageFigures;
use vpm_vdb::scene::Rgb;

fn grey(v: f32) -> Sample {
    Sample {
        direct: Rgb::splat(v),
        ..Sample::NOTHING
    }
}

/// Uniform numbers in 0..1 (Knuth's MMIX generator); the tests need no better.
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[test]
fn mean_and_standard_error_of_four_passes() {
    let mut film = Film::new(1, 1, None);
    assert_eq!(film.standard_error(0, 0), None);
    for v in [1.0, 2.0, 3.0, 6.0] {
        film.add_pass(&[grey(v)]);
    }
    assert_eq!(film.passes(), 4);
    assert!(
        (film.mean(0, 0) - DVec3::splat(3.0)).length() < 1e-12,
        "{}",
        film.mean(0, 0)
    );
    // M2 = 4 + 1 + 0 + 9 = 14; s = sqrt(14 / 12)
    let s = film.standard_error(0, 0).unwrap().x;
    assert!((s - (14.0_f64 / 12.0).sqrt()).abs() < 1e-12, "{s}");
    // A single pixel is the whole image: its mean has the same error.
    let image = film.image_mean();
    assert!(
        (image.standard_error.unwrap().x - s).abs() < 1e-12,
        "{image:?}"
    );
    let relative = film.mean_relative_standard_error().unwrap();
    assert!((relative - s / 3.0).abs() < 1e-12, "{relative}");
}

/// Many independent pixels of a uniform distribution on 0..2 m: the standard error has to be
/// sqrt(m^2 / 3 / n), and the mean must lie within it of m as often as a normal deviate would.
#[test]
fn errors_of_a_known_distribution() {
    let (n, side, m) = (64_u32, 64_u32, 5.0);
    let mut film = Film::new(side, side, None);
    let mut random = Uniform(7);
    for _ in 0..n {
        let pass: Vec<_> = (0..side * side)
            .map(|_| grey((2.0 * m * random.next()) as f32))
            .collect();
        film.add_pass(&pass);
    }
    let expected = (m * m / 3.0 / f64::from(n)).sqrt();
    let pixels = f64::from(side * side);
    let (mut variance, mut inside) = (0.0, 0.0);
    for y in 0..side {
        for x in 0..side {
            let s = film.standard_error(x, y).unwrap().x;
            variance += s * s / pixels;
            inside += f64::from(u8::from((film.mean(x, y).x - m).abs() < s)) / pixels;
        }
    }
    // The variance of a sample variance of a uniform distribution: sigma^4 (0.8 / n + 2 / n^2).
    let spread = ((0.8 / f64::from(n) + 2.0 / f64::from(n * n)) / pixels).sqrt();
    let z = (variance / (expected * expected) - 1.0) / spread;
    assert!(
        z.abs() < 4.0,
        "variance of the pixels is off by {z} standard errors"
    );
    // Student's t with 63 degrees of freedom lies within +-1 with probability 0.6789.
    let p: f64 = 0.6789;
    let z = (inside - p) / (p * (1.0 - p) / pixels).sqrt();
    assert!(z.abs() < 4.0, "coverage {inside}: {z} standard errors");
    // Pixels are independent here, so the image mean is known 64 times better.
    let image = film.image_mean().standard_error.unwrap().x;
    let ratio = image / (expected / f64::from(side));
    // Its own relative spread: 1 / sqrt(2 (n - 1)).
    assert!(
        (ratio - 1.0).abs() < 4.0 / (2.0 * f64::from(n - 1)).sqrt(),
        "{ratio}"
    );
}

/// All pixels of a pass rise and fall together, as with shared photons: the error of the image
/// mean is that of one pixel, not smaller.
#[test]
fn image_mean_knows_that_pixels_are_correlated() {
    let mut film = Film::new(8, 8, None);
    for v in [1.0, 3.0] {
        film.add_pass(&[grey(v); 64]);
    }
    assert_eq!(film.image_mean().standard_error, film.standard_error(3, 3));
}

#[test]
fn exact_pixels_do_not_flatter_the_noise() {
    let relative = |background: f32, count: usize| {
        let mut film = Film::new(1 + count as u32, 1, None);
        for v in [0.9, 1.1] {
            let mut pass = vec![grey(background); count];
            pass.push(grey(v));
            film.add_pass(&pass);
        }
        film.mean_relative_standard_error().unwrap()
    };
    let alone = relative(0.0, 0);
    assert!((alone - 0.1).abs() < 1e-6, "{alone}");
    assert_eq!(relative(0.0, 1000), alone);
    assert_eq!(relative(0.37, 1000), alone);
}

#[test]
fn picture_without_noise_has_no_error() {
    let mut film = Film::new(2, 1, None);
    film.add_pass(&[grey(0.3), grey(0.0)]);
    assert_eq!(film.mean_relative_standard_error(), None);
    film.add_pass(&[grey(0.3), grey(0.0)]);
    assert_eq!(film.mean_relative_standard_error(), Some(0.0));
}

#[test]
fn values_that_are_not_finite_are_counted_and_the_rest_stands() {
    let mut film = Film::new(2, 1, None);
    film.add_pass(&[grey(1.0), grey(2.0)]);
    film.add_pass(&[grey(f32::NAN), grey(2.0)]);
    film.add_pass(&[
        Sample {
            alpha: f32::INFINITY,
            ..grey(9.0)
        },
        grey(2.0),
    ]);
    film.add_pass(&[grey(3.0), grey(2.0)]);
    assert_eq!(film.passes(), 4);
    assert_eq!(film.mean(0, 0), DVec3::splat(2.0));
    assert_eq!(film.nonfinite_passes(0, 0), 2);
    assert_eq!(film.nonfinite_pixels(), 1);
    assert_eq!(ImageFigures::from(&film).nonfinite_pixels, 1);
    assert!(
        film.image_mean().mean.is_finite(),
        "{:?}",
        film.image_mean()
    );
}

#[test]
fn depth_averages_what_was_met() {
    let mut film = Film::new(2, 1, None);
    let at = |depth| Sample {
        depth,
        ..Sample::NOTHING
    };
    for depth in [2.0, f32::INFINITY, 4.0] {
        film.add_pass(&[at(depth), at(f32::INFINITY)]);
    }
    assert_eq!(film.means(0, 0).depth, 3.0);
    assert_eq!(film.means(1, 0).depth, f64::INFINITY);
    assert_eq!(film.nonfinite_pixels(), 0);
}

fn noisy_film() -> Film {
    let mut film = Film::new(7, 5, Some([2, 1, 6, 5]));
    let mut random = Uniform(3);
    for _ in 0..3 {
        let mut value = || random.next() as f32;
        let pass: Vec<_> = (0..16)
            .map(|i| Sample {
                direct: Rgb::new(value(), value(), value()),
                indirect: Rgb::new(value(), value(), value()),
                emission: Rgb::new(value(), value(), value()),
                alpha: value(),
                depth: if i == 5 { f32::INFINITY } else { value() },
            })
            .collect();
        film.add_pass(&pass);
    }
    film
}

#[test]
fn film_goes_to_bytes_and_back() {
    let film = noisy_film();
    let bytes = film.to_bytes();
    let mut back = Film::from_bytes(&bytes).unwrap();
    assert_eq!(back, film);
    // And goes on as if it had never been away.
    let mut on = film;
    on.add_pass(&[grey(0.5); 16]);
    back.add_pass(&[grey(0.5); 16]);
    assert_eq!(back.to_bytes(), on.to_bytes());
    for cut in [0, 4, 8, 40, bytes.len() - 1] {
        let result: Result<_, FilmBytesError> = Film::from_bytes(&bytes[..cut]);
        assert!(result.is_err(), "cut at {cut}");
    }
    let mut huge = bytes;
    huge[8..16].fill(0xff);
    huge[24..32].fill(0xff);
    assert!(Film::from_bytes(&huge).is_err(), "a crop of 2^64 pixels");
}

#[test]
fn exr_keeps_colour_and_errors() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.exr");
    let film = noisy_film();
    let metadata = Metadata {
        scene: "dünn \u{1f525}".into(),
        settings: "photons = 1\n".into(),
    };
    write_exr(&file, &film, &metadata).unwrap();
    let picture = read_exr(&file).unwrap();
    assert_eq!(
        (picture.width, picture.height, picture.origin),
        (4, 4, [2, 1])
    );
    let error = picture.standard_error.unwrap();
    for y in 0..4 {
        for x in 0..4 {
            let i = y * 4 + x;
            let (px, py) = (x as u32 + 2, y as u32 + 1);
            assert_eq!(picture.rgb[i], film.mean(px, py).as_vec3().to_array());
            let expected = film.standard_error(px, py).unwrap().as_vec3().to_array();
            assert_eq!(error[i], expected);
        }
    }
}

#[test]
fn exr_of_one_pass_claims_no_error() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.exr");
    let mut film = Film::new(1, 1, None);
    film.add_pass(&[grey(1.0)]);
    write_exr(&file, &film, &Metadata::default()).expect("scratch folder");
    assert_eq!(
        read_exr(&file).expect("scratch folder").standard_error,
        None
    );
}

fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).expect("scratch folder");
    let mut names: Vec<_> = entries
        .map(|e| {
            e.expect("scratch folder")
                .file_name()
                .into_string()
                .expect("scratch folder")
        })
        .collect();
    names.sort();
    names
}

#[test]
fn png_is_eight_bit_srgb() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.png");
    let mut film = Film::new(2, 1, None);
    film.add_pass(&[grey(0.0), grey(1e6)]);
    write_png(&file, &film, 0.0).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(fs::File::open(&file).unwrap()))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; 6];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(
        (info.width, info.height, info.color_type),
        (2, 1, png::ColorType::Rgb)
    );
    assert_eq!(bytes, [0, 0, 0, 255, 255, 255]);
    assert_eq!(names(dir.path()), ["a.png"]);
}

#[test]
fn a_failed_write_leaves_the_old_file_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a");
    write_bytes(&file, b"old").unwrap();
    let result: Result<(), Box<dyn std::error::Error>> = vpm_vdb::atomic::write(&file, |out| {
        std::io::Write::write_all(out, b"half of the n")?;
        Err("the disc is full".into())
    });
    assert_eq!(result.unwrap_err().to_string(), "the disc is full");
    assert_eq!(fs::read(&file).unwrap(), b"old");
    assert_eq!(names(dir.path()), ["a"]);
    write_bytes(&file, b"new").unwrap();
    assert_eq!(fs::read(&file).unwrap(), b"new");
}

#[test]
fn unwritable_places_are_found_beforehand() {
    let dir = tempfile::tempdir().unwrap();
    check_writable(&dir.path().join("a.exr")).unwrap();
    assert!(names(dir.path()).is_empty(), "the check leaves no trace");

    let missing = dir.path().join("out/a.exr");
    assert_eq!(
        check_writable(&missing).unwrap_err().to_string(),
        format!(
            "cannot write {}: there is no folder {}",
            missing.display(),
            dir.path().join("out").display()
        )
    );
    assert_eq!(
        check_writable(dir.path()).unwrap_err().to_string(),
        format!(
            "cannot write {}: it is not a regular file",
            dir.path().display()
        )
    );
    let protected = dir.path().join("protected.exr");
    fs::write(&protected, "").unwrap();
    let mut permissions = fs::metadata(&protected).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&protected, permissions).unwrap();
    let error = anyhow::Error::from(check_writable(&protected).unwrap_err());
    assert_eq!(
        format!("{error:#}"),
        format!(
            "cannot write {}: the file is there and is write-protected",
            protected.display()
        )
    );
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link() {
    let dir = tempfile::tempdir().unwrap();
    let (file, link) = (dir.path().join("a"), dir.path().join("b"));
    fs::write(&file, "old").unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    write_bytes(&link, b"new").unwrap();
    assert!(
        fs::symlink_metadata(&link).unwrap().is_symlink(),
        "link replaced"
    );
    assert_eq!(fs::read(&file).unwrap(), b"new");
}

#[test]
fn luminance_of_white_is_one() {
    assert!(
        (luminance(DVec3::ONE) - 1.0).abs() < 1e-12,
        "{}",
        luminance(DVec3::ONE)
    );
}
