//! Networks that are widely used, a file of description for each family. `name` is what errors call one.

mod efficientnet_lite;
mod i3d;
mod resnet;
mod squeezenet;

pub use efficientnet_lite::{efficientnet_lite, efficientnet_lite_body};
pub use i3d::i3d;
pub use resnet::{resnet18, resnet50, se_resnext50};
pub use squeezenet::{squeezenet1_0, squeezenet1_1};
