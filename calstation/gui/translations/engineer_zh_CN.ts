<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>ChoicePanel</name>
    <message>
        <source>Enter the engineer&apos;s PIN</source>
        <translation>输入工程师密码</translation>
    </message>
    <message>
        <source>Set the engineer&apos;s PIN</source>
        <translation>设置工程师密码</translation>
    </message>
    <message>
        <source>Reset</source>
        <extracomment>Stages of each part, by the end of the part&apos;s object name.</extracomment>
        <translation>恢复</translation>
    </message>
    <message>
        <source>Back to the product&apos;s values of this stage</source>
        <translation>本阶段恢复为产品的设定值</translation>
    </message>
    <message>
        <source>Save to product</source>
        <translation>存入产品</translation>
    </message>
    <message>
        <source>Schedule: {0}</source>
        <translation>流程参数：{0}</translation>
    </message>
</context>
<context>
    <name>EngineerHeader</name>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Your name</source>
        <translation>姓名</translation>
    </message>
    <message>
        <source>scan or type</source>
        <translation>扫码或输入</translation>
    </message>
    <message>
        <source>your name, for the record</source>
        <translation>您的姓名，用于记录</translation>
    </message>
    <message>
        <source>START</source>
        <translation>开始</translation>
    </message>
</context>
<context>
    <name>EngineerPage</name>
    <message>
        <source>Engineer</source>
        <extracomment>Why station and product cannot be used together.</extracomment>
        <translation>工程师</translation>
    </message>
    <message>
        <source>The program is communicating with the unit.</source>
        <translation>正在与产品通信。</translation>
    </message>
    <message>
        <source>It takes a few seconds; press START again then.</source>
        <translation>需要几秒钟，完成后请再按一次开始。</translation>
    </message>
    <message>
        <source>Is everyone clear of the table and the unit secured?</source>
        <translation>人员是否都已离开转台，产品是否装牢？</translation>
    </message>
    <message>
        <source>None of this product&apos;s stages can run on this station&apos;s rig.</source>
        <translation>该产品的标定阶段都不能在本工位的工装上运行。</translation>
    </message>
    <message>
        <source>Save the schedule of {0} to the product {1}?</source>
        <translation>把“{0}”的流程参数存入产品“{1}”吗？</translation>
    </message>
    <message>
        <source>Show an earlier result or log</source>
        <translation>查看以前的标定结果或数据记录</translation>
    </message>
    <message>
        <source>Every later run of this product uses it. The present version is kept; this one is saved under the name {0}.</source>
        <translation>该产品以后的每次标定都使用这些参数。现有版本予以保留，新版本记在 {0} 名下。</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Save to product</source>
        <translation>存入产品</translation>
    </message>
    <message>
        <source>{0}: version {1} saved</source>
        <translation>{0}：已存为版本 {1}</translation>
    </message>
    <message>
        <source>The product was not saved</source>
        <translation>产品没有保存</translation>
    </message>
    <message>
        <source>Correct the schedule of {0} first.</source>
        <translation>请先改正“{0}”的流程参数。</translation>
    </message>
    <message>
        <source>The serial number does not match this product ({0}).</source>
        <translation>序列号不符合该产品的规则（{0}）。</translation>
    </message>
    <message>
        <source>Correct the marked values first.</source>
        <translation>请先改正标出的数值。</translation>
    </message>
    <message>
        <source>The table of &apos;{0}&apos; is going to move</source>
        <translation>“{0}”的转台即将转动</translation>
    </message>
    <message>
        <source>All clear, start</source>
        <translation>已确认，开始</translation>
    </message>
    <message>
        <source>Open a result or a log</source>
        <translation>打开标定结果或数据记录</translation>
    </message>
    <message>
        <source>Results and logs (*.json *.h5 *.csv *.csv.gz)</source>
        <translation>标定结果和数据记录 (*.json *.h5 *.csv *.csv.gz)</translation>
    </message>
    <message>
        <source>All files (*)</source>
        <translation>所有文件 (*)</translation>
    </message>
    <message>
        <source>This file cannot be opened</source>
        <translation>这个文件打不开</translation>
    </message>
    <message>
        <source>Only an engineer may change this; set the PIN first.</source>
        <translation>仅工程师可修改；请先设置密码。</translation>
    </message>
    <message>
        <source>Only an engineer may change this; enter the PIN first.</source>
        <translation>只有工程师可以修改，请先输入密码。</translation>
    </message>
    <message>
        <source>Enter your name first; it stands in the record.</source>
        <translation>请先填写姓名，它会记入档案。</translation>
    </message>
    <message>
        <source>Choose at least one stage.</source>
        <translation>请至少选择一个阶段。</translation>
    </message>
    <message>
        <source>Enter the unit&apos;s serial number.</source>
        <translation>请输入产品序列号。</translation>
    </message>
    <message>
        <source>Read the fault on the Operator page and press Understood first.</source>
        <translation>请先到操作员页看故障，再按“知道了”。</translation>
    </message>
    <message>
        <source>Being saved.</source>
        <translation>正在保存。</translation>
    </message>
    <message>
        <source>This stage&apos;s values are the product&apos;s.</source>
        <translation>本阶段的数值就是产品的设定值。</translation>
    </message>
    <message>
        <source>Preview</source>
        <translation>预览</translation>
    </message>
    <message>
        <source>Parameters</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>Innovations</source>
        <translation>新息</translation>
    </message>
    <message>
        <source>Residuals</source>
        <translation>残差</translation>
    </message>
    <message>
        <source>Observability</source>
        <translation>可观测性</translation>
    </message>
    <message>
        <source>Registers</source>
        <translation>寄存器</translation>
    </message>
    <message>
        <source>Open</source>
        <translation>打开</translation>
    </message>
</context>
<context>
    <name>HeatMap</name>
    <message>
        <source>{0} after step {1}: {2:.3g} times better known than before the stage</source>
        <translation>{0}，第 {1} 步之后：比本阶段之前准 {2:.3g} 倍</translation>
    </message>
    <message>
        <source>after step</source>
        <translation>步号</translation>
    </message>
    <message>
        <source>east</source>
        <translation>东</translation>
    </message>
    <message>
        <source>{0} after step {1}: not better known than before</source>
        <translation>{0}，第 {1} 步之后：还没有比原来更准</translation>
    </message>
    <message>
        <source>north</source>
        <translation>北</translation>
    </message>
    <message>
        <source>up</source>
        <translation>天</translation>
    </message>
    <message>
        <source>attitude</source>
        <translation>姿态</translation>
    </message>
    <message>
        <source>velocity</source>
        <translation>速度</translation>
    </message>
</context>
<context>
    <name>InnovationsView</name>
    <message>
        <source>Stage</source>
        <extracomment>Largest number of observations inside ±3 σ drawn in each plot; more are thinned out. With fewer observations, a mean below its band is not significant. Least range of a plot, sigmas either way.</extracomment>
        <translation>阶段</translation>
    </message>
    <message>
        <source>time in the stage, min</source>
        <translation>阶段内时间，min</translation>
    </message>
    <message>
        <source>{0} observations, {1:.2f} % beyond ±3 σ (0.27 % expected)</source>
        <translation>{0} 次观测，超出 ±3 σ 的占 {1:.2f} %（理论 0.27 %）</translation>
    </message>
    <message>
        <source>east, σ</source>
        <translation>东，σ</translation>
    </message>
    <message>
        <source>north, σ</source>
        <translation>北，σ</translation>
    </message>
    <message>
        <source>up, σ</source>
        <translation>天，σ</translation>
    </message>
    <message>
        <source>Mean NIS</source>
        <translation>NIS 均值</translation>
    </message>
    <message>
        <source>99.9 % band</source>
        <translation>99.9 % 区间</translation>
    </message>
    <message>
        <source>above: errors that the model does not explain</source>
        <translation>偏大：有模型没有描述的误差</translation>
    </message>
    <message>
        <source>below the band: sigma is conservative</source>
        <translation>低于区间：σ 偏保守</translation>
    </message>
    <message>
        <source>inside</source>
        <translation>在区间内</translation>
    </message>
</context>
<context>
    <name>MotionPlot</name>
    <message>
        <source>outer, °</source>
        <translation>外框，°</translation>
    </message>
    <message>
        <source>inner, °</source>
        <translation>内框，°</translation>
    </message>
    <message>
        <source>time, min</source>
        <translation>时间，min</translation>
    </message>
</context>
<context>
    <name>ObservabilityView</name>
    <message>
        <source>Stage</source>
        <extracomment>Strength from which a state counts as observable. Range of the scale: strengths from 1 to 100 000.</extracomment>
        <translation>阶段</translation>
    </message>
    <message>
        <source>No observability to show</source>
        <translation>没有可观测性数据</translation>
    </message>
    <message>
        <source>Only stages solved by the filter report it: the excitation and the azimuth flips.</source>
        <translation>只有滤波解算的阶段才有：三轴激励和方位翻转。</translation>
    </message>
    <message>
        <source>Not determined by this stage: {0}</source>
        <translation>本阶段无法确定：{0}</translation>
    </message>
    <message>
        <source>Every state is determined by this stage.</source>
        <translation>本阶段能确定全部状态。</translation>
    </message>
</context>
<context>
    <name>Parts</name>
    <message>
        <source>What to calibrate</source>
        <translation>标定内容</translation>
    </message>
    <message>
        <source>Scale factors</source>
        <translation>刻度系数</translation>
    </message>
    <message>
        <source>Installation matrix and lever arms</source>
        <translation>安装误差矩阵和杆臂</translation>
    </message>
    <message>
        <source>Biases</source>
        <translation>零偏</translation>
    </message>
    <message>
        <source>or single stages, in this order:</source>
        <translation>或单选阶段，按以下次序：</translation>
    </message>
</context>
<context>
    <name>PreviewView</name>
    <message>
        <source>Preview</source>
        <extracomment>Height of a row of the table, px.</extracomment>
        <translation>预览</translation>
    </message>
    <message>
        <source>{0} in all, {1} moves</source>
        <translation>共 {0}，转动 {1} 次</translation>
    </message>
    <message>
        <source>{0}; the choice has changed since, preview again</source>
        <translation>{0}；选择已改变，请重新预览</translation>
    </message>
    <message>
        <source>A preview moves nothing</source>
        <translation>预览时转台不动</translation>
    </message>
    <message>
        <source>Choose what to calibrate on the left and press Preview: it shows both axes&apos; angles against time, the total time, whether the table can do it, and the expected sigma of every parameter.</source>
        <translation>在左侧选好标定内容，再按“预览”：显示两轴角度随时间的变化、总时间、转台能否完成，以及各参数的预期标准差。</translation>
    </message>
    <message>
        <source>out of date</source>
        <translation>已过时</translation>
    </message>
    <message>
        <source>beyond the table&apos;s limits</source>
        <translation>超出转台极限</translation>
    </message>
    <message>
        <source>cannot be solved</source>
        <translation>无法解算</translation>
    </message>
    <message>
        <source>within the table&apos;s limits, {0} sigma limits missed</source>
        <translation>转台可以完成，{0} 个参数的标准差达不到限差</translation>
    </message>
    <message>
        <source>within the table&apos;s limits, every sigma limit reached</source>
        <translation>转台可以完成，标准差全部满足限差</translation>
    </message>
    <message>
        <source>{0}: {1} rounds do not reach its targets; set rounds or a duration.</source>
        <translation>{0}：做 {1} 轮也达不到目标，请给定轮数或时长。</translation>
    </message>
    <message>
        <source>{0}, move {1} ({2})</source>
        <translation>{0}，第 {1} 次转动（{2}）</translation>
    </message>
    <message>
        <source>{0} and {1} more</source>
        <translation>{0}及另外 {1} 次</translation>
    </message>
    <message>
        <source>rate {0:g} °/s, the table reaches {1:g} °/s; lower the rate</source>
        <translation>速率 {0:g} °/s，转台最大 {1:g} °/s，请降低速率</translation>
    </message>
    <message>
        <source>acceleration {0:g} °/s², the table reaches {1:g} °/s²; lower the acceleration</source>
        <translation>加速度 {0:g} °/s²，转台最大 {1:g} °/s²，请降低加速度</translation>
    </message>
    <message>
        <source>outer axis</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>inner axis</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>{0} to {1:.1f}°, its travel is {2:.0f}° to {3:.0f}°; choose fewer turns or rounds</source>
        <translation>{0}转到 {1:.1f}°，行程为 {2:.0f}° 到 {3:.0f}°，请减少圈数或轮数</translation>
    </message>
</context>
<context>
    <name>RegisterController</name>
    <message>
        <source>Open a result or finish a run first: its values are what is written.</source>
        <extracomment>Stands for the unit in a request while no serial number is given. Events that tell in which state an incomplete write has left the unit. The last event of `_INCOMPLETE` of the present write.</extracomment>
        <translation>请先打开标定结果或完成一次标定，写入的就是其中的数值。</translation>
    </message>
    <message>
        <source>Read the unit first, so that what changes can be seen.</source>
        <translation>请先读取产品，才能看出哪些内容会改变。</translation>
    </message>
    <message>
        <source>Unit {0} is in the fixture, the result is of {1}.</source>
        <translation>夹具上是产品 {0}，标定结果属于 {1}。</translation>
    </message>
    <message>
        <source>The unit holds these values already.</source>
        <translation>产品里已经是这些数值。</translation>
    </message>
    <message>
        <source>Another page is using a device; try again in a few seconds.</source>
        <translation>另一页面正在与设备通信，请过几秒再试。</translation>
    </message>
    <message>
        <source>Starting the engine and connecting.</source>
        <translation>正在启动并连接设备。</translation>
    </message>
    <message>
        <source>Stopped before anything was written.</source>
        <translation>已停止，没有写入任何内容。</translation>
    </message>
</context>
<context>
    <name>RegistersView</name>
    <message>
        <source>Address</source>
        <translation>地址</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>Open a result or finish a run to see what it would write, and read the unit in the fixture to see what it holds. Nothing is written without confirmation.</source>
        <translation>打开标定结果或完成一次标定，就能看到要写入的内容；读取夹具上的产品，就能看到它现有的内容。不经确认不会写入。</translation>
    </message>
    <message>
        <source>Old</source>
        <translation>原值</translation>
    </message>
    <message>
        <source>stored as</source>
        <translation>存储值</translation>
    </message>
    <message>
        <source>New</source>
        <translation>新值</translation>
    </message>
    <message>
        <source>Change</source>
        <translation>变化</translation>
    </message>
    <message>
        <source>Read the unit</source>
        <extracomment>What verified the present write, &quot;&quot; if there was none; see `Settled.proof`.</extracomment>
        <translation>读取产品</translation>
    </message>
    <message>
        <source>Write to the unit</source>
        <translation>写入产品</translation>
    </message>
    <message>
        <source>Registers, old against new</source>
        <translation>寄存器新旧对比</translation>
    </message>
    <message>
        <source>In the unit</source>
        <translation>产品内</translation>
    </message>
    <message>
        <source>before the run: {0} {1}</source>
        <translation>标定前：{0} {1}</translation>
    </message>
    <message>
        <source>Write, table at rest</source>
        <translation>写入，转台不动</translation>
    </message>
    <message>
        <source>Write and turn the table</source>
        <translation>写入并转动转台</translation>
    </message>
    <message>
        <source>Write {0} registers of unit {1}?</source>
        <translation>写入产品 {1} 的 {0} 个寄存器吗？</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Write {0} registers</source>
        <translation>写入 {0} 个寄存器</translation>
    </message>
    <message>
        <source>{0} of them change, exactly as the table shows below ({1}); all others keep their values. The unit commits them to flash and restarts: flash write number {2} known here. The journal records it under the name {3}.</source>
        <translation>其中 {0} 个会改变，与下表完全一致（{1}），其余保持不变。产品将其存入闪存并重启，这是本机所知第 {2} 次写闪存。日志记在 {3} 名下。</translation>
    </message>
    <message>
        <source>Then its output is checked at rest; do not touch the unit.</source>
        <translation>写入后在静止状态下检查输出，请勿碰动产品。</translation>
    </message>
    <message>
        <source>The table of “{0}” moves: home first, then whole turns of both axes before and after the write, which verify the gyros as well. Is everyone clear of the table and the unit secured? STOP works at any time.</source>
        <translation>“{0}”的转台会转动：先回零，写入前后两轴各转整圈，这样陀螺也能得到验证。人员是否都已离开转台，产品是否装牢？随时可以按停止。</translation>
    </message>
    <message>
        <source>being written</source>
        <translation>正在写入</translation>
    </message>
    <message>
        <source>not done</source>
        <translation>没有完成</translation>
    </message>
    <message>
        <source>written and read back</source>
        <translation>已写入并回读一致</translation>
    </message>
    <message>
        <source>written by the run</source>
        <translation>已由本次标定写入</translation>
    </message>
    <message>
        <source>{0} differ</source>
        <translation>{0} 个不同</translation>
    </message>
    <message>
        <source>equal</source>
        <translation>一致</translation>
    </message>
    <message>
        <source>Verified with a turn of the table.</source>
        <translation>已用转台转动验证，输出正确。</translation>
    </message>
    <message>
        <source>Verified at rest; no turn was made.</source>
        <translation>已在静止状态下验证，输出正确；没有转动。</translation>
    </message>
    <message>
        <source>Only read back: the unit&apos;s output does not show its registers.</source>
        <translation>仅回读核对：本机不输出按寄存器修正后的数据。</translation>
    </message>
    <message>
        <source>Unit {0}, {1}, firmware {2}; flash writes known here: {3}.</source>
        <translation>产品 {0}，{1}，固件 {2}；本机所知写闪存次数：{3}。</translation>
    </message>
    <message>
        <source>A virtual unit starts afresh with every bench.</source>
        <translation>虚拟产品每次都从头开始。</translation>
    </message>
    <message>
        <source>In the unit: as the run wrote it and read it back, {0}.</source>
        <translation>产品内：本次标定写入并回读的值（{0}）。</translation>
    </message>
    <message>
        <source>In the unit: as the run wrote it and read it back.</source>
        <translation>产品内：本次标定写入并回读的值。</translation>
    </message>
    <message>
        <source>Old: as the run found them. Read the unit to see what it holds now.</source>
        <translation>原值是标定时读到的；读取产品可看到现在的内容。</translation>
    </message>
    <message>
        <source>Read the unit to see what it holds now.</source>
        <translation>读取产品可看到它现在的内容。</translation>
    </message>
</context>
<context>
    <name>ResidualsView</name>
    <message>
        <source>gravity, µg</source>
        <extracomment>A rest is named by the axis that is within this angle (its cosine) of up. Each rest drawn, as its stage and its number in it.</extracomment>
        <translation>重力，µg</translation>
    </message>
    <message>
        <source>vertical rate, °/h</source>
        <translation>垂向角速率，°/h</translation>
    </message>
    <message>
        <source>horizontal rate, °/h</source>
        <translation>水平角速率，°/h</translation>
    </message>
    <message>
        <source>rest, by the axis that is up</source>
        <translation>静止位置，按朝上的轴</translation>
    </message>
    <message>
        <source>Measured minus expected at every rest, with ±1 σ of the rest&apos;s own noise; point at a rest.</source>
        <translation>每个静止位置补偿后的测量值减理论值，误差棒为该位置噪声的 ±1 σ；指向一点可看详情。</translation>
    </message>
    <message>
        <source>: {0:+.2f} µg, {1:+.4f} °/h vertical, {2:+.4f} °/h horizontal</source>
        <translation>：{0:+.2f} µg，垂向 {1:+.4f} °/h，水平 {2:+.4f} °/h</translation>
    </message>
    <message>
        <source>{0}, rest {1}, up ({2:+.2f}, {3:+.2f}, {4:+.2f})</source>
        <translation>{0}，第 {1} 个位置，天向 ({2:+.2f}, {3:+.2f}, {4:+.2f})</translation>
    </message>
    <message>
        <source>, outer {0:.1f}°, inner {1:.1f}°</source>
        <translation>，外框 {0:.1f}°，内框 {1:.1f}°</translation>
    </message>
</context>
<context>
    <name>ResultAnalysis</name>
    <message>
        <source>The log is no longer there.</source>
        <extracomment>The log whose diagnostics are shown or being computed.</extracomment>
        <translation>数据记录已不在原处。</translation>
    </message>
    <message>
        <source>Opening {0}</source>
        <translation>正在打开 {0}</translation>
    </message>
    <message>
        <source>The run ended without a result: {0}</source>
        <translation>这次标定没有得出结果：{0}</translation>
    </message>
</context>
<context>
    <name>ResultView</name>
    <message>
        <source>Unit</source>
        <extracomment>A change of more than this many sigmas is marked. Greatest height of the table of checks that concern no single parameter, px. Shape of each verdict of a parameter (`widgets.badge.KINDS`). The verdict of each parameter, a key of `_SHAPES`.</extracomment>
        <translation>单位</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>数值</translation>
    </message>
    <message>
        <source>± σ</source>
        <translation>± σ</translation>
    </message>
    <message>
        <source>Previous</source>
        <translation>上次</translation>
    </message>
    <message>
        <source>Change</source>
        <translation>变化</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>折合 σ</translation>
    </message>
    <message>
        <source>Value limit</source>
        <translation>数值限差</translation>
    </message>
    <message>
        <source>σ limit</source>
        <translation>σ 限差</translation>
    </message>
    <message>
        <source>Stage</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation>结论</translation>
    </message>
    <message>
        <source>Copy table</source>
        <translation>复制表格</translation>
    </message>
    <message>
        <source>The selected rows, or all, as a table for a spreadsheet (Ctrl+C)</source>
        <translation>复制所选行或全部，可粘贴到电子表格（Ctrl+C）</translation>
    </message>
    <message>
        <source>read back only: the unit&apos;s output does not show its registers</source>
        <translation>仅回读核对：本机不输出修正后的数据</translation>
    </message>
    <message>
        <source>Parameters of the run</source>
        <translation>标定参数</translation>
    </message>
    <message>
        <source>solved offline, no limits</source>
        <translation>离线解算，没有限差</translation>
    </message>
    <message>
        <source>solved offline, inside the limits</source>
        <translation>离线解算，满足限差</translation>
    </message>
    <message>
        <source>solved offline, outside the limits</source>
        <translation>离线解算，超出限差</translation>
    </message>
    <message>
        <source>{0} of {1} checks passed</source>
        <translation>{1} 项检查，{0} 项合格</translation>
    </message>
    <message>
        <source>near-misses: {0}</source>
        <translation>临界 {0} 项</translation>
    </message>
    <message>
        <source>registers written {0}</source>
        <translation>寄存器写入于 {0}</translation>
    </message>
    <message>
        <source>registers written</source>
        <translation>寄存器已写入</translation>
    </message>
    <message>
        <source>kept, found better before: {0}</source>
        <translation>保留原值（先前精度更高）：{0}</translation>
    </message>
    <message>
        <source>inside</source>
        <translation>在限内</translation>
    </message>
    <message>
        <source>near-miss</source>
        <translation>临界</translation>
    </message>
    <message>
        <source>value outside</source>
        <translation>数值超差</translation>
    </message>
    <message>
        <source>σ too large</source>
        <translation>σ 过大</translation>
    </message>
    <message>
        <source>value outside, σ too large</source>
        <translation>数值超差且 σ 过大</translation>
    </message>
    <message>
        <source>not determined</source>
        <translation>无法确定</translation>
    </message>
    <message>
        <source>no limit</source>
        <translation>无限差</translation>
    </message>
</context>
<context>
    <name>_Columns</name>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>σ before</source>
        <translation>原有 σ</translation>
    </message>
    <message>
        <source>σ limit</source>
        <translation>σ 限差</translation>
    </message>
    <message>
        <source>σ target</source>
        <translation>σ 目标</translation>
    </message>
    <message>
        <source>Expected</source>
        <translation>预期</translation>
    </message>
    <message>
        <source>This stage does not estimate it.</source>
        <translation>本阶段不估计它。</translation>
    </message>
    <message>
        <source>{0:.3g} times better known than before this stage</source>
        <translation>比本阶段之前准 {0:.3g} 倍</translation>
    </message>
    <message>
        <source>no limit</source>
        <translation>无限差</translation>
    </message>
    <message>
        <source>reached</source>
        <translation>可达到</translation>
    </message>
    <message>
        <source>missed</source>
        <translation>达不到</translation>
    </message>
</context>
<context>
    <name>_LazyView</name>
    <message>
        <source>Nothing to show for this run</source>
        <translation>这次标定没有可显示的内容</translation>
    </message>
    <message>
        <source>No run opened yet</source>
        <translation>还没有打开标定结果</translation>
    </message>
    <message>
        <source>Finish a run, open a result or a log here, or choose a run on the History page.</source>
        <translation>完成一次标定，或在这里打开标定结果、数据记录，也可以在历史页选择一次标定。</translation>
    </message>
    <message>
        <source>Solving the log again</source>
        <translation>正在重新解算数据记录</translation>
    </message>
    <message>
        <source>Innovations and residuals are computed from the log; the result does not store them.</source>
        <translation>新息和残差由数据记录算出，不随结果保存。</translation>
    </message>
</context>
<context>
    <name>_StageRow</name>
    <message>
        <source>Move {0} one up</source>
        <translation>{0}上移一位</translation>
    </message>
    <message>
        <source>Move {0} one down</source>
        <translation>{0}下移一位</translation>
    </message>
</context>
<context>
    <name>verdict</name>
    <message>
        <source>{0} (partial)</source>
        <translation>{0}（部分）</translation>
    </message>
    <message>
        <source>{0} (partial: {1})</source>
        <translation>{0}（部分：{1}）</translation>
    </message>
</context>
</TS>
