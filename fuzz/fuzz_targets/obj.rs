//! Any bytes, read as OBJ.
#![no_main]

use libfuzzer_sys::fuzz_target;
use meshmill::formats::Format;

fuzz_target!(|bytes: &[u8]| meshmill_fuzz::check(Some(Format::Obj), bytes));
