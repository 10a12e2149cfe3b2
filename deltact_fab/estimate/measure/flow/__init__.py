"""Dense optical flow of the colour pattern, and its total from the first image on.

The paper (Dense Optical Flow and Adaptive Reference) uses Farneback's algorithm on a GPU, gives no
parameters, and adds an adaptive reference after Du et al. 2021. `FlowMethod` is one flow between
two images; `FlowTracker` follows a sequence and reports its confidence.

Results of DIS depend on cv2's number of threads (it splits the image by thread): the caller fixes
it with cv2.setNumThreads, and records it where bytes must repeat.
"""
