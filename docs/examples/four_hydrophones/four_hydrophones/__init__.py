"""A bearing from four hydrophones: another package's stage of uw_acoustic_loc."""
