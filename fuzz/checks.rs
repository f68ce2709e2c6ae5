//! The tests' laws, shapes and targets.

#[path = "../tests/common/laws.rs"]
pub mod laws;
#[path = "../tests/common/mod.rs"]
pub mod shapes;
#[path = "../tests/common/targets.rs"]
pub mod targets;
