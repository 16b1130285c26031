//! The viewer of progressive meshes as text: its JavaScript, and the HTML page of a document with
//! the mesh inside it or beside it.
//!
//! It knows no file and no mesh: what stands in the page is bytes, passed through.

mod base64;
mod module;
mod page;

pub use module::module;
pub use page::{Data, Page, write};
