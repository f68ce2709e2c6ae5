//! Read, weld, sharpen, bend, write, read.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| sharpen_fuzz::targets::file(bytes));
