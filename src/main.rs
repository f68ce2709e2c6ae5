//! The `sharpen` command.

fn main() {}
