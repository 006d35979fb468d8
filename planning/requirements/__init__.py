"""What a view must satisfy: one file per requirement, each giving the same record of margins.

`margin` holds the record and what a requirement is; `magnification` what requirements leave of d/D
for the orthogonal view of the paper. All judge `planning.views.Views`; many judge them at once in
`planning.judgement.judge`.
"""
