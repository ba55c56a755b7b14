//! Which instruction set the inner loops use.

/// An instruction set that this processor has; made only by detection, so that holding one proves it may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Level(pub(super) InstructionSet);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum InstructionSet {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    Portable,
}

impl Level {
    /// The fastest level of this processor.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if has_avx512() {
            return Self(InstructionSet::Avx512);
        } else if has_avx2() {
            return Self(InstructionSet::Avx2);
        }
        Self(InstructionSet::Portable)
    }

    /// Every level of this processor.
    #[cfg(test)]
    pub fn available() -> Vec<Self> {
        let mut levels = vec![Self(InstructionSet::Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            levels.extend(has_avx2().then_some(Self(InstructionSet::Avx2)));
            levels.extend(has_avx512().then_some(Self(InstructionSet::Avx512)));
        }
        levels
    }
}

/// Name of the instruction set the inner loops use on this processor: `avx512`, `avx2` or `portable`.
pub fn instruction_set() -> &'static str {
    match Level::best().0 {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => "avx512",
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => "avx2",
        InstructionSet::Portable => "portable",
    }
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}

#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    has_avx2()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512vl")
}
