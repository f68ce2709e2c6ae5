//! The OBJ reader against `tobj`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| sharpen_fuzz::targets::against_tobj(bytes));
