% stage: written by robustid; run it, and stage is a model of the Control System Toolbox.
stage_A = [0.85000361604448516 0.50664315264779625 0 0;
  -0.50664315264779625 0.74867498551492595 0 0;
  0 0 0.44605345226291759 0.89183866048144012;
  0 0 -0.89183866048144 0.43891874297906619];
stage_B = [0.14999638395551482;
  0.50664315264779625;
  0.55394654773708241;
  0.89183866048144];
stage_C = [0.90000000000000002 0 0.059400000000000001 0];
stage_D = [0];
stage = ss(stage_A, stage_B, stage_C, stage_D, 0.01);
stage.InputName = {'force'};
stage.OutputName = {'displacement'};
