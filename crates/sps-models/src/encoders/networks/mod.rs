//! The networks, a file of description each.

mod efficientnet_lite;
mod i3d;
mod resnet;
mod se_resnext;
mod squeezenet;

pub(super) use efficientnet_lite::{efficientnet_lite, efficientnet_lite_body};
pub(super) use i3d::i3d;
pub(super) use resnet::{resnet18, resnet50};
pub(super) use se_resnext::se_resnext50;
pub(super) use squeezenet::{squeezenet1_0, squeezenet1_1};
