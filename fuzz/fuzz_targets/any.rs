//! Any bytes, whose format and compression are found out.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| meshmill_fuzz::check(None, bytes));
