//! Surfaces and media together.
