//! Pictures in files: the film as layered EXR, the tone-mapped PNG, and EXR read back.
//!
//! The EXR is one part with 32-bit float channels, lossless (ZIP), colour in linear Rec. 709:
//!
//! | channels | content |
//! |---|---|
//! | `R G B A` | radiance \[W/(m2 sr)\]; alpha = 1 - transmittance |
//! | `stderr.R G B` | standard error of `R G B`; absent for a picture of one pass |
//! | `direct.R G B` | light scattered once |
//! | `indirect.R G B` | light scattered more than once |
//! | `emission.R G B` | emission, and the background seen through the medium |
//! | `depth.Z` | distance from the camera \[m\]; infinite where there is nothing |
//!
//! `R G B` = direct + indirect + emission. The attribute `comments` says in TOML how the picture was
//! made: the scene, the passes in it, and its `[render]` section. (Attributes of our own would
//! come in an order that changes from run to run, as the crate keeps them in a hash map; equal
//! pictures are to be equal files.) A crop is a data window inside the full display window.

use std::fs::File;
use std::io::{BufReader, Cursor, Write};
use std::path::{Path, PathBuf};

use exr::meta::attribute::{IntegerBounds, Text};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, ReadChannels,
    ReadLayers, Vec2, WritableImage,
};

use crate::atomic::{self, OutputError};
use crate::film::{Film, PixelMeans};
use crate::tone;

/// A picture cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The place of the file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The file cannot be opened.
    #[error("cannot read {}", file.display())]
    Open {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not an EXR this program understands.
    #[error("cannot read {} as EXR", file.display())]
    Decode {
        /// The file.
        file: PathBuf,
        /// Why.
        source: exr::error::Error,
    },
    /// No colour in it.
    #[error("{} has no channels R, G, B; it has: {found}", file.display())]
    NoColour {
        /// The file.
        file: PathBuf,
        /// Names of its channels.
        found: String,
    },
    /// The encoder failed, for example on a full disc.
    #[error("cannot write {}", file.display())]
    EncodeExr {
        /// The file.
        file: PathBuf,
        /// Why.
        source: exr::error::Error,
    },
    /// The encoder failed, for example on a full disc.
    #[error("cannot write {}", file.display())]
    EncodePng {
        /// The file.
        file: PathBuf,
        /// Why.
        source: png::EncodingError,
    },
}

/// Text stored with a picture, so that it can be made again.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Metadata {
    /// Scene name.
    pub scene: String,
    /// All settings, as a `[render]` section.
    pub settings: String,
}

/// Colour of a picture read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width. \[px\]
    pub width: u32,
    /// Height. \[px\]
    pub height: u32,
    /// Corner of these pixels in the full picture. \[px\]
    pub origin: [i32; 2],
    /// Linear RGB, row-major.
    pub rgb: Vec<[f32; 3]>,
    /// Standard errors of `rgb`, if the file has them.
    pub standard_error: Option<Vec<[f32; 3]>>,
}

/// Name of a channel, and its value in a pixel.
type ChannelOf = (&'static str, fn(&PixelMeans) -> f64);

/// Channels computed from the means; the standard error is apart.
const CHANNELS: [ChannelOf; 14] = [
    ("R", |p| p.direct.x + p.indirect.x + p.emission.x),
    ("G", |p| p.direct.y + p.indirect.y + p.emission.y),
    ("B", |p| p.direct.z + p.indirect.z + p.emission.z),
    ("A", |p| p.alpha),
    ("direct.R", |p| p.direct.x),
    ("direct.G", |p| p.direct.y),
    ("direct.B", |p| p.direct.z),
    ("indirect.R", |p| p.indirect.x),
    ("indirect.G", |p| p.indirect.y),
    ("indirect.B", |p| p.indirect.z),
    ("emission.R", |p| p.emission.x),
    ("emission.G", |p| p.emission.y),
    ("emission.B", |p| p.emission.z),
    ("depth.Z", |p| p.depth),
];

/// The pixels of the film's crop, row-major.
fn crop_pixels(film: &Film) -> impl Iterator<Item = (u32, u32)> {
    let [x0, y0, x1, y1] = film.crop();
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (x, y)))
}

/// EXR text is Latin-1; anything else is replaced, not refused: it is only a label.
fn text(s: &str) -> Text {
    let latin: String = s
        .chars()
        .map(|c| if u32::from(c) < 256 { c } else { '?' })
        .collect();
    Text::new_or_none(&latin).unwrap_or_default()
}

/// Writes the film with all layers, whole or not at all.
pub fn write_exr(file: &Path, film: &Film, metadata: &Metadata) -> Result<(), ImageError> {
    let image = layered(film, metadata);
    atomic::write(file, |out| {
        image
            .write()
            .to_buffered(out)
            .map_err(|source| ImageError::EncodeExr {
                file: file.to_owned(),
                source,
            })
    })
}

/// Encodes a film as both files without writing them; their size. \[bytes\]
pub(crate) fn encoded_size(film: &Film, exposure: f64) -> usize {
    let metadata = Metadata {
        scene: String::new(),
        settings: String::new(),
    };
    let mut exr = Cursor::new(Vec::new());
    let mut png = Vec::new();
    let [x0, y0, x1, y1] = film.crop();
    let done = layered(film, &metadata)
        .write()
        .to_buffered(&mut exr)
        .is_ok()
        && encode_png(&mut png, x1 - x0, y1 - y0, &tone_mapped(film, exposure)).is_ok();
    if done {
        exr.into_inner().len() + png.len()
    } else {
        0
    }
}

/// The film's layers.
fn layered(film: &Film, metadata: &Metadata) -> Image<Layer<AnyChannels<FlatSamples>>> {
    let [x0, y0, x1, y1] = film.crop();
    let channel = |name: &str, samples: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(samples));
    let means: Vec<PixelMeans> = crop_pixels(film).map(|(x, y)| film.means(x, y)).collect();
    let mut channels: Vec<_> = CHANNELS
        .iter()
        .map(|(name, of)| channel(name, means.iter().map(|p| of(p) as f32).collect()))
        .collect();
    if film.passes() >= 2 {
        for (i, name) in ["stderr.R", "stderr.G", "stderr.B"].into_iter().enumerate() {
            // Unknown in a pixel whose passes were nearly all not finite.
            let error = |(x, y)| film.standard_error(x, y).map_or(f32::NAN, |e| e[i] as f32);
            channels.push(channel(name, crop_pixels(film).map(error).collect()));
        }
    }

    let comments = format!(
        "scene = {:?}\npasses_in_picture = {}\n\n{}",
        metadata.scene,
        film.passes(),
        metadata.settings
    );
    let attributes = LayerAttributes {
        layer_position: Vec2(x0 as i32, y0 as i32),
        comments: Some(text(&comments)),
        software_name: Some(text(concat!("vpm-vdb ", env!("CARGO_PKG_VERSION")))),
        ..LayerAttributes::default()
    };
    let layer = Layer::new(
        Vec2((x1 - x0) as usize, (y1 - y0) as usize),
        attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels.into()),
    );
    let [width, height] = film.resolution();
    let mut image = Image::from_layer(layer);
    image.attributes.display_window =
        IntegerBounds::new(Vec2(0, 0), Vec2(width as usize, height as usize));
    image
}

/// Writes the film as eight-bit sRGB (see `tone`), whole or not at all. `exposure` in stops.
pub fn write_png(file: &Path, film: &Film, exposure: f64) -> Result<(), ImageError> {
    let [x0, y0, x1, y1] = film.crop();
    write_rgb8(file, x1 - x0, y1 - y0, &tone_mapped(film, exposure))
}

/// Eight-bit sRGB of the film.
fn tone_mapped(film: &Film, exposure: f64) -> Vec<u8> {
    crop_pixels(film)
        .flat_map(|(x, y)| {
            let v = tone::map(film.mean(x, y).to_array(), exposure);
            [0, 1, 2].map(|c| tone::quantise(v[c as usize], x, y, c))
        })
        .collect()
}

/// Writes rows of red, green, blue bytes in sRGB, whole or not at all.
pub fn write_rgb8(file: &Path, width: u32, height: u32, bytes: &[u8]) -> Result<(), ImageError> {
    atomic::write(file, |out| {
        encode_png(out, width, height, bytes).map_err(|source| ImageError::EncodePng {
            file: file.to_owned(),
            source,
        })
    })
}

/// PNG of rows of red, green, blue bytes in sRGB.
pub(crate) fn encode_png(
    out: impl Write,
    width: u32,
    height: u32,
    bytes: &[u8],
) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()
}

/// Reads colour, and its standard errors if they are there, from an EXR of any source: the first
/// layer with channels `R`, `G`, `B`, whatever other channels and layers there are.
pub fn read_exr(file: &Path) -> Result<Picture, ImageError> {
    let open = File::open(file).map_err(|source| ImageError::Open {
        file: file.to_owned(),
        source,
    })?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(BufReader::new(open))
        .map_err(|source| ImageError::Decode {
            file: file.to_owned(),
            source,
        })?;

    for layer in &image.layer_data {
        let count = layer.size.area();
        let find = |name: &str| {
            let list = &layer.channel_data.list;
            let channel = list.iter().find(|c| c.name.eq(name))?;
            // A subsampled channel is no colour.
            (channel.sample_data.len() == count).then_some(&channel.sample_data)
        };
        let triple = |names: [&str; 3]| -> Option<Vec<[f32; 3]>> {
            let [r, g, b] = names.map(find);
            let (r, g, b) = (r?.values_as_f32(), g?.values_as_f32(), b?.values_as_f32());
            Some(r.zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect())
        };
        if let Some(rgb) = triple(["R", "G", "B"]) {
            return Ok(Picture {
                width: layer.size.width() as u32,
                height: layer.size.height() as u32,
                origin: [
                    layer.attributes.layer_position.x(),
                    layer.attributes.layer_position.y(),
                ],
                rgb,
                standard_error: triple(["stderr.R", "stderr.G", "stderr.B"]),
            });
        }
    }
    let names = image.layer_data.iter().flat_map(|l| &l.channel_data.list);
    let found = names
        .map(|c| c.name.to_string())
        .collect::<Vec<_>>()
        .join(", ");
    Err(ImageError::NoColour {
        file: file.to_owned(),
        found,
    })
}
