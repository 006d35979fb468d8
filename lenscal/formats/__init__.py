"""Other people's files, one file per format.

======================  ======  ======  ==========================================================
module                  writes  reads   holds
======================  ======  ======  ==========================================================
`opencv_yaml`           yes     yes     one camera; distortion of the other direction, fitted
`camera_info`           yes     yes     ROS: one camera, or a set of them over zoom; likewise
`mrcal_model`           yes     yes     one camera; likewise
`colmap`                yes     yes     cameras by number; likewise
`ulens`                 yes     yes     Unreal: a table over zoom and focus; likewise
`opentrackio`           yes     yes     samples over zoom and focus; κ1 as it is
`samples_csv`           yes     yes     any quantities over zoom and focus, with σ
`lensfun`               no      yes     distortion over focal length
`tsai`                  yes     yes     R. Willson's cameras and points; κ1 as it is
======================  ======  ======  ==========================================================

What these formats call focal length is our image distance d, in px, mm or shares of the sensor.
"""
