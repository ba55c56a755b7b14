//! The surfaces and poses that the built-in scenes are made of.
