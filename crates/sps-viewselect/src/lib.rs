//! Selection of the best few views (or sensors) of many: NVS, VB-NVS, TRN, greedy, exhaustive and baselines.
