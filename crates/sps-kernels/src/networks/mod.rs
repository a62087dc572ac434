//! Networks that are widely used, a file of description each. `name` is what errors call one.

mod efficientnet_lite;
mod i3d;
mod resnet;
mod se_resnext;
mod squeezenet;

pub use efficientnet_lite::{efficientnet_lite, efficientnet_lite_body};
pub use i3d::i3d;
pub use resnet::{resnet18, resnet50};
pub use se_resnext::se_resnext50;
pub use squeezenet::{squeezenet1_0, squeezenet1_1};
