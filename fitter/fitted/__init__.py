"""One material as fitted: numbers, verdicts, limitations."""
