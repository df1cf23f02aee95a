# Rules of all results, from study/results/known.py; written by `make commands`.
campaigns := scenes/scenes.csv budget.json quality/quality.json sweep/sweep.json ablation/ablation.json power.json
others := hard/hard.json hard-rtl/hard.json hard-paper/hard.json synth.json memories.json fpga-tiny.json fpga.json
$(RESULTS)/scenes/scenes.csv: ; $(measure) bench scenes --timing lpddr4 --quality compact --out $(@D) $(SCENES) $(size) $(preset)
$(RESULTS)/budget.json: ; $(measure) error --stage all --json $@ $(SCENES) $(size) $(preset)
$(RESULTS)/quality/quality.json: ; $(measure) bench quality --psnr , --out $(@D) $(SCENES) $(size) $(preset)
$(RESULTS)/sweep/sweep.json: ; $(measure) bench sweep --out $(@D) $(SCENES) $(size) $(addprefix --point ,$(POINTS))
$(RESULTS)/hard/hard.json: ; $(measure) hard --engine golden -o $(@D) --json $@ $(preset)
$(RESULTS)/hard-rtl/hard.json: ; $(measure) hard --engine rtl --preset TINY -o $(@D) --json $@
$(RESULTS)/hard-paper/hard.json: ; $(measure) hard --engine golden --preset PAPER -o $(@D) --json $@
$(RESULTS)/synth.json: ; $(measure) synth --stage top --json $@ $(preset)
$(RESULTS)/memories.json: ; $(measure) memories --json $@ $(preset)
$(RESULTS)/ablation/ablation.json: ; $(measure) bench ablation --out $(@D) $(SCENES) $(size) $(preset)
$(RESULTS)/power.json: ; $(measure) power --json $@ $(SCENE) $(addprefix --camera ,$(CAMERA)) $(size) $(preset)
$(RESULTS)/fpga-tiny.json: ; $(measure) fpga --preset TINY --json $@
$(RESULTS)/fpga.json: ; $(measure) fpga --json $@ $(preset)
$(RESULTS)/fpga-whole.json: ; $(measure) fpga --whole --speed 8 --json $@
$(RESULTS)/compression/compression.json: ; $(measure) bench compression $(few) --out $(@D) $(SCENES)
$(RESULTS)/scale/scale.json: ; $(measure) bench scale --out $(@D) $(size)
$(RESULTS)/levels/levels.json: ; $(measure) bench levels $(SCENE) $(addprefix --camera ,$(CAMERA)) --out $(@D) $(size) $(preset)
