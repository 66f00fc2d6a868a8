//! The value types of grids: their size in the file, and how OpenVDB negates and prints them.

use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};

/// The value type of a grid, from its type name `Tree_<type>_5_4_3`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueType {
    /// 16-bit float in memory as well (file version 225).
    Half,
    /// 32-bit float, perhaps stored with 16 bits.
    Float,
    /// 64-bit float, perhaps stored with 16 bits.
    Double,
    /// 32-bit integer.
    Int32,
    /// 64-bit integer.
    Int64,
    /// A bit per voxel beside the active bit.
    Bool,
    /// Only the active bit.
    Mask,
    /// Three 32-bit floats.
    Vec3s,
    /// Three 64-bit floats.
    Vec3d,
    /// Three 32-bit integers.
    Vec3i,
    /// Points, not values.
    Points,
    /// Anything else.
    Other,
}

impl ValueType {
    /// From the type name of the file, without `_HalfFloat`.
    pub(crate) fn from_type_name(name: &str) -> Self {
        match name
            .strip_prefix("Tree_")
            .and_then(|n| n.strip_suffix("_5_4_3"))
        {
            Some("half") => Self::Half,
            Some("float") => Self::Float,
            Some("double") => Self::Double,
            Some("int32") => Self::Int32,
            Some("int64") => Self::Int64,
            Some("bool") => Self::Bool,
            Some("mask") => Self::Mask,
            Some("vec3s") => Self::Vec3s,
            Some("vec3d") => Self::Vec3d,
            Some("vec3i") => Self::Vec3i,
            Some(n) if n.starts_with("ptdataidx") || n.starts_with("ptidx") => Self::Points,
            _ => Self::Other,
        }
    }

    /// OpenVDB's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Half => "half",
            Self::Float => "float",
            Self::Double => "double",
            Self::Int32 => "int32",
            Self::Int64 => "int64",
            Self::Bool => "bool",
            Self::Mask => "mask",
            Self::Vec3s => "vec3s",
            Self::Vec3d => "vec3d",
            Self::Vec3i => "vec3i",
            Self::Points => "points",
            Self::Other => "other",
        }
    }

    /// Whether `read_scalar` takes it.
    pub fn is_scalar(self) -> bool {
        matches!(
            self,
            Self::Half
                | Self::Float
                | Self::Double
                | Self::Int32
                | Self::Int64
                | Self::Bool
                | Self::Mask
        )
    }

    /// Whether its values are real numbers, which alone can be stored as half floats.
    pub fn is_real(self) -> bool {
        matches!(
            self,
            Self::Half | Self::Float | Self::Double | Self::Vec3s | Self::Vec3d
        )
    }

    /// Whether `read_vec3` takes it.
    pub fn is_vec3(self) -> bool {
        matches!(self, Self::Vec3s | Self::Vec3d | Self::Vec3i)
    }
}

/// A single value at full precision, as OpenVDB would return it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// Of a half or float grid.
    Float(f32),
    /// Of a double grid.
    Double(f64),
    /// Of an int32 or int64 grid.
    Int(i64),
    /// Of a bool or mask grid.
    Bool(bool),
    /// Of a vec3s grid.
    Vec3s([f32; 3]),
    /// Of a vec3d grid.
    Vec3d([f64; 3]),
    /// Of a vec3i grid.
    Vec3i([i32; 3]),
}

/// A type that nodes store.
pub(crate) trait Stored: Copy + Send + Sync + Default + 'static {
    /// Bytes of a value.
    const BYTES: usize;
    /// Bytes of a value in the buffers of a file saved as half; other types do not change.
    const HALF_BYTES: usize;
    /// Whether saving as half concerns it.
    const REAL: bool;
    /// Numbers in a value: 1, or 3 for a vector.
    const COMPONENTS: usize;
    /// From exactly `BYTES` bytes.
    fn load(raw: &[u8]) -> Self;
    /// OpenVDB's `math::negative`: the other inactive value of a level set.
    fn negative(self) -> Self;
    /// Same bits.
    fn same(self, other: Self) -> bool;
    /// A voxel of a leaf that stores bits.
    fn from_bit(bit: bool) -> Self;
    /// From `BYTES` bytes for each value of `out`.
    fn unpack(raw: &[u8], out: &mut [Self]);
    /// From `HALF_BYTES` bytes for each value of `out`.
    fn unpack_half(raw: &[u8], out: &mut [Self]) {
        Self::unpack(raw, out);
    }
    /// For printing.
    fn value(self) -> Value;
    /// Component `axis` < COMPONENTS, for statistics.
    fn component(self, axis: usize) -> f64;
}

/// A stored type as the renderer's number.
pub(crate) trait Scalar: Stored {
    fn scalar(self) -> f32;
}

/// A stored type as the renderer's vector.
pub(crate) trait Vector: Stored {
    fn vector(self) -> [f32; 3];
}

macro_rules! number {
    ($T:ty {
        real: $real:literal,
        bytes: $bytes:literal,
        half_bytes: $half_bytes:literal,
        unpack_half: $unpack_half:expr,
        negative: $negative:expr,
        bits: $bits:expr,
        value: $value:expr,
        wide: $wide:expr,
    }) => {
        impl Stored for $T {
            const REAL: bool = $real;
            const BYTES: usize = $bytes;
            const HALF_BYTES: usize = $half_bytes;
            const COMPONENTS: usize = 1;
            fn load(raw: &[u8]) -> Self {
                let mut a = [0; $bytes];
                a.copy_from_slice(raw);
                Self::from_le_bytes(a)
            }
            fn negative(self) -> Self {
                $negative(self)
            }
            fn same(self, other: Self) -> bool {
                $bits(self) == $bits(other)
            }
            fn from_bit(bit: bool) -> Self {
                <Self as From<u8>>::from(u8::from(bit))
            }
            fn unpack(raw: &[u8], out: &mut [Self]) {
                for (v, &b) in out.iter_mut().zip(raw.as_chunks::<$bytes>().0) {
                    *v = Self::from_le_bytes(b);
                }
            }
            fn unpack_half(raw: &[u8], out: &mut [Self]) {
                $unpack_half(raw, out);
            }
            fn value(self) -> Value {
                $value(self)
            }
            fn component(self, _: usize) -> f64 {
                $wide(self)
            }
        }
    };
}

number!(f16 {
    real: true,
    bytes: 2,
    half_bytes: 2,
    unpack_half: Self::unpack,
    negative: |v: f16| -v,
    bits: f16::to_bits,
    value: |v: f16| Value::Float(v.to_f32()),
    wide: f16::to_f64,
});
number!(f32 {
    real: true,
    bytes: 4,
    half_bytes: 2,
    unpack_half: halves_to_floats,
    negative: |v: f32| -v,
    bits: f32::to_bits,
    value: Value::Float,
    wide: f64::from,
});
number!(f64 {
    real: true,
    bytes: 8,
    half_bytes: 2,
    unpack_half: halves_to_doubles,
    negative: |v: f64| -v,
    bits: f64::to_bits,
    value: Value::Double,
    wide: |v| v,
});
number!(i32 {
    real: false,
    bytes: 4,
    half_bytes: 4,
    unpack_half: Self::unpack,
    negative: i32::wrapping_neg,
    bits: |v: i32| v,
    value: |v: i32| Value::Int(v.into()),
    wide: f64::from,
});
number!(i64 {
    real: false,
    bytes: 8,
    half_bytes: 8,
    unpack_half: Self::unpack,
    negative: i64::wrapping_neg,
    bits: |v: i64| v,
    value: Value::Int,
    wide: |v| v as f64,
});

fn halves_to_doubles(raw: &[u8], out: &mut [f64]) {
    for (v, &b) in out.iter_mut().zip(raw.as_chunks::<2>().0) {
        *v = f16::from_le_bytes(b).to_f64();
    }
}

/// Converts in batches that the processor's own half instructions take.
fn halves_to_floats(raw: &[u8], out: &mut [f32]) {
    let mut bits = [0u16; 512];
    for (raw, out) in raw.chunks(2 * bits.len()).zip(out.chunks_mut(512)) {
        let bits = &mut bits[..out.len()];
        for (b, &r) in bits.iter_mut().zip(raw.as_chunks::<2>().0) {
            *b = u16::from_le_bytes(r);
        }
        bits.reinterpret_cast::<f16>().convert_to_f32_slice(out);
    }
}

impl Stored for bool {
    const BYTES: usize = 1;
    const HALF_BYTES: usize = 1;
    const REAL: Self = false;
    const COMPONENTS: usize = 1;
    fn load(raw: &[u8]) -> Self {
        raw.first().is_some_and(|&b| b != 0)
    }
    fn negative(self) -> Self {
        !self
    }
    fn same(self, other: Self) -> bool {
        self == other
    }
    fn from_bit(bit: bool) -> Self {
        bit
    }
    fn unpack(raw: &[u8], out: &mut [Self]) {
        for (v, b) in out.iter_mut().zip(raw) {
            *v = *b != 0;
        }
    }
    fn value(self) -> Value {
        Value::Bool(self)
    }
    fn component(self, _: usize) -> f64 {
        f64::from(u8::from(self))
    }
}

macro_rules! vector {
    ($T:ty, $value:expr) => {
        impl Stored for [$T; 3] {
            const BYTES: usize = 3 * <$T as Stored>::BYTES;
            const HALF_BYTES: usize = 3 * <$T as Stored>::HALF_BYTES;
            const REAL: bool = <$T as Stored>::REAL;
            const COMPONENTS: usize = 3;
            fn load(raw: &[u8]) -> Self {
                let mut v = Self::default();
                <$T>::unpack(raw, &mut v);
                v
            }
            fn negative(self) -> Self {
                self.map(<$T>::negative)
            }
            fn same(self, other: Self) -> bool {
                self.iter().zip(other).all(|(&a, b)| a.same(b))
            }
            fn from_bit(bit: bool) -> Self {
                [<$T>::from_bit(bit); 3]
            }
            fn unpack(raw: &[u8], out: &mut [Self]) {
                <$T>::unpack(raw, out.as_flattened_mut());
            }
            fn unpack_half(raw: &[u8], out: &mut [Self]) {
                <$T>::unpack_half(raw, out.as_flattened_mut());
            }
            fn value(self) -> Value {
                $value(self)
            }
            fn component(self, axis: usize) -> f64 {
                self[axis].component(0)
            }
        }
    };
}

vector!(f32, Value::Vec3s);
vector!(f64, Value::Vec3d);
vector!(i32, Value::Vec3i);

impl Scalar for f16 {
    fn scalar(self) -> f32 {
        self.to_f32()
    }
}
impl Scalar for f32 {
    fn scalar(self) -> f32 {
        self
    }
}
impl Scalar for f64 {
    fn scalar(self) -> f32 {
        self as f32
    }
}
impl Scalar for i32 {
    fn scalar(self) -> f32 {
        self as f32
    }
}
impl Scalar for i64 {
    fn scalar(self) -> f32 {
        self as f32
    }
}
impl Scalar for bool {
    fn scalar(self) -> f32 {
        f32::from(u8::from(self))
    }
}
impl Vector for [f32; 3] {
    fn vector(self) -> [f32; 3] {
        self
    }
}
impl Vector for [f64; 3] {
    fn vector(self) -> [f32; 3] {
        self.map(|v| v as f32)
    }
}
impl Vector for [i32; 3] {
    fn vector(self) -> [f32; 3] {
        self.map(|v| v as f32)
    }
}
