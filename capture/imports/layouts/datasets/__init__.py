"""Data sets of papers, in the layouts that their authors published."""
