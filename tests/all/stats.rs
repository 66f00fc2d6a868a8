//! Significance of comparisons: the library's own, which its self-test uses too.

pub(crate) use vpm_vdb::stats::{Welford, chi_square_p, ks_p, sidak, t_bound, z_bound};
