//! The STL reader, and what each writer makes of what it reads.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| sharpen_fuzz::targets::reader(
    bytes,
    sharpen::io::Format::Stl(None)
));
